from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bscd.acquisition import CameraMeta, RunFile, RunWriter
from bscd.calibration import GridTarget
from bscd.errors import CheckFailedError, InputError
from bscd.procedures import Observations, Progress, observe, record_scan
from tests.procedures.conftest import BSC
from tests.procedures.twin_rig import TARGET, TwinRig


def rewritten(run: RunFile, path: Path, change) -> RunFile:
    """A copy of a run with its frames changed; ``change(record)`` returns a record, or None to leave it out."""
    with RunWriter(path, title="changed", cameras=run.cameras) as writer:
        for record in run.frames():
            if (changed := change(record)) is not None:
                writer.append(changed)
    return RunFile(path)


def truth_px(camera: str, pose: str, y_mm: float, side: int, index) -> np.ndarray:
    """The twin's exact images of the dots, at the nominal stage readings."""
    twin = TwinRig()
    state = twin.world.state()._replace(
        rotation_deg=45.0 if pose == "corner" else 0.0,
        translation_mm=50.0 + y_mm,
        jack_mm=70.0 if side else 5.0,
    )
    view = next(view for view in twin.world.dots(camera, state) if view.side == side)
    place = {int(label): xy for label, xy in zip(view.index, view.xy_px, strict=True)}
    return np.array([place[int(label)] for label in index])


class TestWhatIsSeen:
    def test_reference_views_are_where_the_twin_puts_the_dots(self, observed: dict[str, Observations]) -> None:
        seen = observed["reference"]
        assert len(seen.views) == 12
        assert {view.camera for view in seen.views} == {"primary", "auxiliary"}
        assert seen.image_size_px == (640, 512)
        for view in seen.views:
            assert len(view.index) == (414 if view.pose == "corner" else 207)
            off = view.xy_px - truth_px(view.camera, view.pose, view.y_mm, 0, view.index)
            # the stages come to rest within 0.002 deg and 0.5 um of their readings, well below a hundredth of a pixel
            assert np.abs(off).max() < 0.15
            assert np.abs(off.mean(axis=0)).max() < 0.02

    def test_biprism_views_are_where_the_twin_puts_the_dots(self, observed: dict[str, Observations]) -> None:
        seen = observed["bsc"]
        assert [(view.camera, view.pose, view.position) for view in seen.views[:3]] == [
            ("left", "corner", 0),
            ("right", "corner", 0),
            ("left", "face", -2),
        ]
        assert seen.split is not None
        assert seen.jack_mm == (70.0,) * 6
        for view in seen.views:
            side = -1 if view.camera == "left" else 1
            off = view.xy_px - truth_px("primary", view.pose, view.y_mm, side, view.index)
            assert np.abs(off.mean(axis=0)).max() < 0.02

    def test_repeated_frames_are_averaged(self, twin: TwinRig, tmp_path: Path) -> None:
        recipe = BSC.model_copy(update={"positions": 1, "frames_per_position": 4})
        record_scan(twin.rig, recipe, TARGET, tmp_path / "scan.h5")
        with RunFile(tmp_path / "scan.h5") as run:
            said: list[Progress] = []
            assert len(observe(run, TARGET, "bsc", progress=said.append).views) == 4
        assert [(progress.done, progress.total) for progress in said] == [(1, 2), (2, 2)]

    def test_covered_dots_are_named_with_reasons(
        self, runs: dict[str, RunFile], observed: dict[str, Observations], tmp_path: Path
    ) -> None:
        covered = observed["bsc"].views[2]
        assert (covered.camera, covered.pose) == ("left", "face")
        middle = covered.xy_px[100]

        def cover(record):
            if record.phase != "bsc-face" or record.target_position != covered.position:
                return record
            data = record.data.copy()
            column, row = np.rint(middle).astype(int)
            data[row - 12 : row + 13, column - 12 : column + 13] = 150
            return _with_data(record, data)

        with rewritten(runs["bsc"], tmp_path / "covered.h5", cover) as run:
            seen = observe(run, TARGET, "bsc")
        named = {(m.camera, m.pose, m.position, m.dot.index) for m in seen.missing}
        assert ("left", "face", covered.position, int(covered.index[100])) in named
        assert all(m.dot.reason for m in seen.missing)


def _with_data(record, data):
    return replace(record, data=data)


class TestWhatIsRefused:
    def test_a_missing_phase(self, runs: dict[str, RunFile], tmp_path: Path) -> None:
        def no_corner(record):
            return None if record.phase == "bsc-corner" else record

        with (
            rewritten(runs["bsc"], tmp_path / "changed.h5", no_corner) as run,
            pytest.raises(InputError, match=r"no bsc-corner frames of the primary camera \(it has bsc-face\)"),
        ):
            observe(run, TARGET, "bsc")

    def test_a_scan_of_the_other_kind(self, runs: dict[str, RunFile]) -> None:
        with pytest.raises(InputError, match="no reference-corner frames of the primary camera"):
            observe(runs["bsc"], TARGET, "reference")
        with pytest.raises(InputError, match="no bsc-corner frames"):
            observe(runs["reference"], TARGET, "bsc")

    def test_saturated_images(self, runs: dict[str, RunFile], tmp_path: Path) -> None:
        def overexpose(record):
            data = np.minimum(record.data.astype(int) * 3, 255).astype(np.uint8)
            return _with_data(record, data) if record.target_position in (1, 2) else record

        with (
            rewritten(runs["bsc"], tmp_path / "changed.h5", overexpose) as run,
            pytest.raises(CheckFailedError, match=r"POS.\+1: .*saturated; shorten.*\(2 of 6 images can not be used\)"),
        ):
            observe(run, TARGET, "bsc")

    def test_prism_out_of_the_way_of_a_biprism_scan(self, runs: dict[str, RunFile], tmp_path: Path) -> None:
        phases = {"reference-corner": "bsc-corner", "reference-face": "bsc-face"}
        with (
            relabelled(runs["reference"], tmp_path / "changed.h5", phases) as run,
            pytest.raises(CheckFailedError, match="biprism is not in the view; raise it"),
        ):
            observe(run, TARGET, "bsc")

    def test_prism_in_the_way_of_a_reference_scan(self, runs: dict[str, RunFile], tmp_path: Path) -> None:
        phases = {"bsc-corner": "reference-corner", "bsc-face": "reference-face"}
        with (
            relabelled(runs["bsc"], tmp_path / "changed.h5", phases, twice=True) as run,
            pytest.raises(CheckFailedError, match="biprism is in the view; lower it"),
        ):
            observe(run, TARGET, "reference")

    def test_wrong_dot_count(self, runs: dict[str, RunFile]) -> None:
        with pytest.raises(CheckFailedError, match=r"\[target\]"):
            observe(runs["reference"], GridTarget(rows=21), "reference")

    def test_a_place_that_is_not_known(self, runs: dict[str, RunFile], tmp_path: Path) -> None:
        def no_y(record):
            return replace(record, y_mm=float("nan"))

        with (
            rewritten(runs["bsc"], tmp_path / "changed.h5", no_y) as run,
            pytest.raises(InputError, match="y_mm is not known; give it in the manifest"),
        ):
            observe(run, TARGET, "bsc")

    def test_a_position_that_one_camera_lacks_is_told(self, runs: dict[str, RunFile], tmp_path: Path) -> None:
        def one_less(record):
            return None if (record.camera, record.target_position) == ("auxiliary", 2) else record

        with rewritten(runs["reference"], tmp_path / "changed.h5", one_less) as run:
            warnings = observe(run, TARGET, "reference").warnings
        assert any("POS.+2 was seen by the primary camera only" in text for text in warnings)


def relabelled(run: RunFile, path: Path, phases: dict[str, str], twice: bool = False) -> RunFile:
    """A copy of the primary camera's frames under other phases, for both cameras if ``twice``."""
    meta: CameraMeta = run.cameras["primary"]
    cameras = {"primary": meta, "auxiliary": meta} if twice else {"primary": meta}
    with RunWriter(path, title="changed", cameras=cameras) as writer:
        for camera in cameras:
            for record in run.frames("primary"):
                writer.append(replace(record, camera=camera, phase=phases[record.phase]))
    return RunFile(path)
