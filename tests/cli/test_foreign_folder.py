"""A folder of images with a manifest that another program left must calibrate; bad ones get one clear line."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from bscd.calibration import Calibration, GridTarget
from bscd.calibration.dots import SplitRegion, find_grid, find_split
from bscd.cli.app import run
from tests.cli.foreign_folder import ForeignRig

POSITIONS, STEP_MM = range(-3, 4), 5.0


@pytest.fixture(scope="module")
def rig():
    foreign = ForeignRig()
    yield foreign
    foreign.world.close()


@pytest.fixture(scope="module")
def folder(rig, tmp_path_factory):
    made = tmp_path_factory.mktemp("foreign")
    rig.write(made, POSITIONS, STEP_MM, rotation=False)
    return made


@pytest.fixture(scope="module")
def calibration(folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("out")
    assert run(["import", str(folder), str(out / "run.h5")]) == 0
    assert run(["calibrate", str(out / "run.h5"), str(out / "run.h5"), "-o", str(out / "cal.h5")]) == 0
    return Calibration.load(out / "cal.h5")


def test_it_calibrates_to_the_floor(rig, calibration):
    """Dots between the positions, turned by 2 degrees, against their true places."""
    errors, floors = [], []
    for y_mm in (-12.0, -2.0, 7.0):
        state = rig.state(2.0, y_mm, 70.0)
        image = rig.image("primary", 2.0, y_mm, 70.0)
        split = find_split([image])
        halves = [find_grid(image, GridTarget(), "face", region=SplitRegion(split, half)) for half in ("left", "right")]
        both, left, right = np.intersect1d(halves[0].index, halves[1].index, return_indices=True)
        xy = [halves[0].xy_px[left], halves[1].xy_px[right]]
        seen = next(view for view in rig.world.dots("primary", state) if view.side == -1)
        truth = seen.xyz_mm[np.searchsorted(seen.index, both)]
        found = calibration.reconstruct(*xy)
        assert found.inside.mean() > 0.7
        errors.append(np.linalg.norm(found.xyz_mm - truth, axis=1)[found.inside])
        rays = [rig.world.rays("primary", image_xy, state) for image_xy in xy]
        across = [np.eye(3) - r.direction[:, :, None] * r.direction[:, None, :] for r in rays]
        right_side = sum(np.einsum("nij,nj->ni", a, r.origin_mm) for a, r in zip(across, rays, strict=True))
        floor = np.linalg.solve(sum(across), right_side[..., None])[..., 0] - truth
        floors.append(np.linalg.norm(floor, axis=1)[found.inside])
    error, floor = np.concatenate(errors).mean(), np.concatenate(floors).mean()
    assert error <= 1.15 * floor  # seven single frames instead of 17 averaged ones
    assert error <= 0.015


def changed(folder: Path, tmp_path: Path, edit=None, **images) -> Path:
    """The folder again (hard links), with an edited manifest, and images replaced or (None) left out."""
    new = tmp_path / "folder"
    new.mkdir()
    for path in folder.iterdir():
        if path.name not in images and path.name != "manifest.csv":
            os.link(path, new / path.name)
    text = (folder / "manifest.csv").read_text()
    (new / "manifest.csv").write_text(edit(text) if edit else text)
    for name, image in images.items():
        if isinstance(image, bytes):
            (new / name).write_bytes(image)
        elif image is not None:
            cv2.imwrite(str(new / name), image)
    return new


def refusal(folder: Path, tmp_path: Path, capsys, calibrate: bool = True) -> str:
    """What the commands say on the way to a calibration; they must fail with sentences, not with a traceback."""
    out = tmp_path / "run.h5"
    status = run(["import", str(folder), str(out)])
    if calibrate and status == 0:
        capsys.readouterr()
        status = run(["calibrate", str(out), str(out), "-o", str(tmp_path / "cal.h5")])
    told = capsys.readouterr().err
    assert status == 1
    assert "Traceback" not in told
    assert not (tmp_path / "cal.h5").exists()
    errors = [
        line for line in told.splitlines() if "error" in line or ".csv" in line or ".h5" in line or ".png" in line
    ]
    assert errors, told
    return told


FACE = "bsc_face_+1_primary.png"


def test_missing_image(folder, tmp_path, capsys):
    told = refusal(changed(folder, tmp_path, **{FACE: None}), tmp_path, capsys)
    assert FACE in told


def test_unreadable_image(folder, tmp_path, capsys):
    told = refusal(changed(folder, tmp_path, **{FACE: b"not a picture"}), tmp_path, capsys)
    assert FACE in told


def test_typo_in_the_manifest(folder, tmp_path, capsys):
    wrong = changed(folder, tmp_path, lambda text: text.replace("bsc-face", "bsc-fase", 1))
    told = refusal(wrong, tmp_path, capsys)
    assert "bsc-fase" in told
    assert "did you mean" in told
    assert "bsc-face" in told


def test_wrong_dot_count(folder, tmp_path, capsys):
    wrong = changed(
        folder, tmp_path, **{"rig.toml": (folder / "rig.toml").read_bytes().replace(b"rows = 23", b"rows = 21")}
    )
    told = refusal(wrong, tmp_path, capsys)
    assert "21" in told
    assert "23" in told


def test_saturated_image(folder, tmp_path, capsys):
    bright = cv2.imread(str(folder / FACE), cv2.IMREAD_GRAYSCALE).astype(float) * 2.2
    told = refusal(changed(folder, tmp_path, **{FACE: np.clip(bright, 0, 255).astype(np.uint8)}), tmp_path, capsys)
    assert "saturated" in told
    assert "exposure" in told


def test_prism_in_the_wrong_place(folder, rig, tmp_path, capsys):
    without = rig.image("primary", 0.0, STEP_MM, 5.0)
    told = refusal(changed(folder, tmp_path, **{FACE: without}), tmp_path, capsys)
    assert "prism" in told


def test_prism_in_the_reference_scan(folder, rig, tmp_path, capsys):
    through = rig.image("primary", 0.0, STEP_MM, 70.0)
    told = refusal(changed(folder, tmp_path, **{"reference_face_+1_primary.png": through}), tmp_path, capsys)
    assert "prism" in told


def test_three_positions(folder, tmp_path, capsys):
    def keep(text):
        return "".join(line for line in text.splitlines(True) if not any(f"_{k:+d}_" in line for k in (-3, -2, 2, 3)))

    told = refusal(changed(folder, tmp_path, keep), tmp_path, capsys)
    assert "3 positions" in told


def test_no_such_files(tmp_path, capsys):
    assert run(["import", str(tmp_path / "none"), str(tmp_path / "run.h5")]) == 1
    assert run(["calibrate", str(tmp_path / "none.h5"), str(tmp_path / "none.h5"), "-o", str(tmp_path / "c.h5")]) == 1
    (tmp_path / "text.h5").write_text("not a run")
    assert run(["calibrate", str(tmp_path / "text.h5"), str(tmp_path / "text.h5"), "-o", str(tmp_path / "c.h5")]) == 1
    told = capsys.readouterr().err
    assert "none.h5" in told
    assert "text.h5" in told
    assert "Traceback" not in told
