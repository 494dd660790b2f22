"""Images of a sphere and an inflation that another program left: from the folder to the results by commands alone."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from bscd.analysis.surface import fit_sphere
from bscd.arrays import BoolArray, FloatArray
from bscd.calibration import Calibration
from bscd.cli.app import run
from bscd.results import FrameResult, ResultsFile
from drivers.twin.placement import RigState
from tests.cli.foreign_folder import LOWERED_MM, OPTIONS, RAISED_MM, ForeignRig

POSITIONS, STEP_MM = range(-2, 3), 7.0
PRESSURES_KPA = (0.05, 1.5, 4.0, 8.0, 13.0)
RADIUS_MM = OPTIONS.sphere.radius_mm


@pytest.fixture(scope="module")
def rig() -> Iterator[ForeignRig]:
    foreign = ForeignRig()
    yield foreign
    foreign.world.close()


@pytest.fixture(scope="module")
def made(rig: ForeignRig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder imported, calibrated and measured, with no seed and no range."""
    images, out = tmp_path_factory.mktemp("images"), tmp_path_factory.mktemp("out")
    rig.write_all(images, POSITIONS, STEP_MM, PRESSURES_KPA)
    both = [str(out / "run.h5")] * 2
    assert run(["import", str(images), both[0]]) == 0
    assert run(["calibrate", *both, "-o", str(out / "cal.h5")]) == 0
    measure = ["measure", str(out / "cal.h5"), both[0], "--step", "12", "-o"]
    assert run([*measure, str(out / "sphere.h5"), "--phase", "sphere"]) == 0
    assert run([*measure, str(out / "pair.h5"), "--phase", "sphere", "--stereo", "standard"]) == 0
    assert run([*measure, str(out / "inflation.h5")]) == 0
    return out


@dataclass(frozen=True, eq=False)
class Seen:
    """A results file beside the truth: where each point's material is in each frame, and where there is any."""

    frames: list[FrameResult]
    truth_mm: list[FloatArray]
    known: list[BoolArray]
    outward: FloatArray | None
    reference: tuple[int, ...]

    def valid_share(self, k: int) -> float:
        """Of what is on the speckled surface and inside the calibrated hull."""
        return float(self.frames[k].valid[self.known[k]].mean())

    def points_mm(self, k: int) -> FloatArray:
        return self.frames[k].xyz_mm[self.frames[k].valid & self.known[k]]


@pytest.fixture(scope="module")
def seen(rig: ForeignRig, made: Path):
    hull = Calibration.load(made / "cal.h5").hull

    def beside_truth(name: str, states: list[RigState]) -> Seen:
        with ResultsFile(made / f"{name}.h5") as results:
            frames, points, membrane = list(results.frames()), results.points_px, results.header.membrane
            reference = results.header.reference_frames
        surface = rig.world.surface("primary", points, states[0])
        speckled = surface.speckled & np.isfinite(surface.material_mm).all(axis=1)
        material = np.where(speckled[:, None], surface.material_mm, 0.0)
        truth = [rig.world.surface_positions(material, state) for state in states]
        known = [speckled & hull.contains(truth[0]) & hull.contains(each) for each in truth]
        return Seen(frames, truth, known, None if membrane is None else membrane.axes[2], reference)

    return beside_truth


@pytest.fixture(scope="module")
def inflation(seen, rig: ForeignRig) -> Seen:
    return seen("inflation", [rig.object_state("membrane", RAISED_MM, p) for p in PRESSURES_KPA])


@pytest.mark.parametrize(("name", "jack_mm", "frames"), [("sphere", RAISED_MM, 2), ("pair", LOWERED_MM, 1)])
def test_the_sphere_has_its_radius(seen, rig, name, jack_mm, frames):
    """Bounds of the shipped twin, but for the scatter: the noise is 3 grey levels everywhere, not 2 in the light."""
    found = seen(name, [rig.object_state("sphere", jack_mm)] * frames)
    assert len(found.frames) == frames
    points = found.points_mm(frames - 1)
    assert len(points) > 1200
    assert found.valid_share(frames - 1) >= (0.95 if name == "sphere" else 0.9)
    assert abs(fit_sphere(points).radius_mm - RADIUS_MM) <= 0.01
    fixed = fit_sphere(points, radius_mm=RADIUS_MM)
    assert abs(fixed.mean_mm) <= 5.6e-4
    assert fixed.std_mm <= 0.018
    error = np.linalg.norm((found.frames[-1].xyz_mm - found.truth_mm[-1])[found.known[-1]], axis=1)
    assert np.nanmedian(error) <= 0.02


@pytest.mark.parametrize("k", range(1, len(PRESSURES_KPA)))
def test_w_is_true_to_the_noise(inflation, k):
    """One noisy frame is the reference, so w has twice the scatter of the shipped twin; sigma says so."""
    frame, known = inflation.frames[k], inflation.frames[k].valid & inflation.known[k]
    assert inflation.valid_share(k) >= 0.98
    truth = (inflation.truth_mm[k] - inflation.truth_mm[0]) @ inflation.outward
    error = (frame.uvw_mm[:, 2] - truth)[known]
    rms = float(np.sqrt(np.mean(error**2)))
    assert rms <= 0.026
    expected = np.sqrt(np.mean(frame.displacement_sigma_mm[known] ** 2, axis=0))
    assert rms <= 1.25 * expected[1]  # w runs along the depth
    assert np.abs(error).max() < 0.4
    assert abs(error.mean()) < 0.004


def test_the_empty_cells_stay_empty(inflation):
    assert inflation.reference == (0,)
    pressures = [frame.pressure_kpa for frame in inflation.frames]
    assert np.isnan(pressures).tolist() == [False, True, True, False, True]
    assert pressures[3] == pytest.approx(8.0)
    assert np.isnan([frame.time_s for frame in inflation.frames]).all()


@pytest.mark.parametrize("kind", ["csv", "vtk", "mat"])
def test_it_is_exported(made, tmp_path, kind):
    assert run(["export", str(made / "inflation.h5"), "--to", kind, str(tmp_path / kind)]) == 0
    assert len(list((tmp_path / kind).iterdir())) >= 1
    if kind == "csv":
        first = np.genfromtxt(tmp_path / "csv/frame_0004.csv", delimiter=",", names=True)
        assert np.nanmax(first["w_mm"]) > 4.5
