"""The membrane inflated on the twin to 16 kPa (DESIGN section 3, step 6), held against the twin's truth."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from bscd.acquisition import RunFile
from bscd.arrays import BoolArray, FloatArray
from bscd.calibration import Calibration
from bscd.procedures.measuring import Measurement, MeasureSettings, measure_run
from bscd.results import FrameResult
from tests.procedures.measuring.twin_runs import PRESSURES_KPA, REST_KPA, TwinRuns, write

STRAIN_INSIDE_MM = 12.0  # the window's 15 mm less half a VSG of 6 mm


@dataclass(frozen=True, eq=False)
class Measured:
    measurement: Measurement
    frames: list[FrameResult]
    speckled: BoolArray
    material_mm: FloatArray
    truth_mm: list[FloatArray]

    def known(self, k: int) -> BoolArray:
        return self.frames[k].valid & self.speckled

    def error_uvw(self, k: int) -> FloatArray:
        axes = self.measurement.frame.axes
        truth = (self.truth_mm[k] - self.truth_mm[0]) @ axes.T
        return (self.frames[k].uvw_mm - truth)[self.known(k)]


def follow(calibration: Calibration, twin_runs: TwinRuns, path, states=None, **settings) -> Measured:
    """Measure a run; its states, by default, are those of its pressures."""
    with RunFile(path) as run:
        measurement = measure_run(calibration, run, MeasureSettings(**settings))
        frames = list(measurement.frames)
    states = states or [twin_runs.inflated(frame.pressure_kpa) for frame in frames]
    material, speckled = twin_runs.material(measurement.sequence.points_px, states[0])
    truth = [twin_runs.world.surface_positions(material, state) for state in states]
    return Measured(measurement, frames, speckled, material, truth)


@pytest.fixture(scope="module")
def inflated(wide: Calibration, twin_runs: TwinRuns, inflation_run) -> Measured:
    return follow(wide, twin_runs, inflation_run)


@pytest.fixture(scope="module")
def noisy(inflated: Measured, wide: Calibration, twin_runs: TwinRuns, tmp_path_factory: pytest.TempPathFactory):
    @cache
    def by(noise_times: float) -> Measured:
        if noise_times == 1.0:
            return inflated
        path = tmp_path_factory.mktemp("noisy") / "inflation.h5"
        return follow(wide, twin_runs, write(path, twin_runs.inflation(PRESSURES_KPA, noise_times)), strain=False)

    return by


def rms(values: FloatArray) -> FloatArray:
    return np.sqrt(np.mean(values**2, axis=0))


def test_the_frames_before_the_ramp_are_the_reference(inflated: Measured):
    assert inflated.measurement.header.reference_frames == (0, 1, 2)
    assert [frame.number for frame in inflated.frames] == list(range(len(PRESSURES_KPA)))
    assert np.allclose([frame.pressure_kpa for frame in inflated.frames], PRESSURES_KPA)
    assert np.allclose([frame.time_s for frame in inflated.frames], np.arange(len(PRESSURES_KPA)) / 11)


def test_displacements_in_the_membrane_frame(inflated: Measured):
    assert np.nanmax(inflated.frames[-1].uvw_mm[:, 2]) > 5.7
    for k in range(len(inflated.frames)):
        u, v, w = rms(inflated.error_uvw(k))
        assert w <= 0.012
        assert u <= 0.005
        assert v <= 0.005


def test_points_that_stay_visible_are_kept(inflated: Measured, wide: Calibration):
    visible = inflated.speckled & inflated.measurement.sequence.reference.valid
    for frame, truth in zip(inflated.frames, inflated.truth_mm, strict=True):
        staying = visible & wide.hull.contains(truth)
        assert staying.sum() > 2000
        assert frame.valid[staying].mean() >= 0.98


def test_the_membrane_frame_faces_the_camera(inflated: Measured):
    frame = inflated.measurement.frame
    assert frame.axes[2] @ [0.0, -1.0, 0.0] > 0.99
    assert np.allclose(frame.axes @ frame.axes.T, np.eye(3), atol=1e-12)


def test_what_is_valid_is_known_and_what_is_not_is_nan(inflated: Measured):
    for frame in inflated.frames:
        for name in ("xyz_mm", "displacement_mm", "uvw_mm", "sigma_mm", "displacement_sigma_mm", "left_px", "right_px"):
            values = getattr(frame, name)
            assert np.isfinite(values[frame.valid]).all(), name
        assert np.isnan(frame.xyz_mm[~frame.valid]).all()


def test_strain(inflated: Measured, twin_runs: TwinRuns):
    assert inflated.measurement.header.parameters["vsg_mm"] <= 6.0
    rest = twin_runs.inflated(REST_KPA)
    inside = np.hypot(*inflated.material_mm.T) < STRAIN_INSIDE_MM
    for frame in inflated.frames:
        truth = twin_runs.principal_strain(inflated.material_mm, rest, twin_runs.inflated(frame.pressure_kpa))
        error = (frame.principal - truth)[inside & frame.valid & np.isfinite(frame.principal).all(axis=1)]
        assert len(error) > 1200
        assert rms(error).max() <= 1e-3
    assert truth.max() > 0.12


def test_strain_at_step_5(wide: Calibration, twin_runs: TwinRuns, inflation_run):
    fine = follow(wide, twin_runs, inflation_run, step_px=5)
    assert fine.measurement.header.parameters["vsg_mm"] <= 6.0
    rest = twin_runs.inflated(REST_KPA)
    inside = np.hypot(*fine.material_mm.T) < STRAIN_INSIDE_MM
    for frame in fine.frames[3::4]:
        truth = twin_runs.principal_strain(fine.material_mm, rest, twin_runs.inflated(frame.pressure_kpa))
        error = (frame.principal - truth)[inside & frame.valid & fine.speckled]
        assert len(error) > 5000
        assert np.isfinite(error).all(axis=1).mean() > 0.95  # not at the hull
        assert rms(error[np.isfinite(error).all(axis=1)]).max() <= 1e-3


def coverage(measured: Measured, k: int) -> FloatArray:
    """The share of displacement errors within one sigma, in world x, y, z."""
    known = measured.known(k)
    truth = measured.truth_mm[k] - measured.truth_mm[0]
    error = np.abs(measured.frames[k].displacement_mm - truth)[known]
    return np.mean(error < measured.frames[k].displacement_sigma_mm[known], axis=0)


class TestSigma:
    def test_rests_on_the_noise_where_the_points_are(self, inflated: Measured, inflation_run):
        with RunFile(inflation_run) as run:
            first, second = (
                frame.data.astype(float) for frame, _ in zip(run.frames("primary"), range(2), strict=False)
            )
        columns, rows = np.rint(inflated.measurement.sequence.points_px).astype(int).T
        there = np.concatenate(
            [(first - second)[rows + j, columns + i] for j in range(-4, 5) for i in range(-4, 5)]
        ).std() / np.sqrt(2.0)
        assert inflated.measurement.header.parameters["noise_frame_grey"] == pytest.approx(there, rel=0.07)
        assert there > 1.1 * np.std(first - second) / np.sqrt(2.0)

    def test_of_the_reference(self, inflated: Measured):
        found = inflated.measurement.sequence.reference
        known = found.valid & inflated.speckled
        covered = np.mean(np.abs(found.xyz_mm - inflated.truth_mm[0])[known] < found.sigma_mm[known], axis=0)
        assert np.abs(covered - 0.68).max() <= 0.07, covered

    @pytest.mark.parametrize("noise_times", [1.0, 2.0])
    def test_at_rest_and_after_a_rigid_motion(
        self, wide: Calibration, twin_runs: TwinRuns, tmp_path, noise_times: float
    ):
        rest = twin_runs.inflated(REST_KPA)
        placement = rest.placement._replace(shift_mm=(0.4, -1.0, 0.3))
        moved = rest._replace(placement=placement)
        # the pressure that ends the reference: its own frames share its noise
        states, pressures = [rest, rest, rest, moved], [REST_KPA, REST_KPA, 0.1, 0.1]
        records = [
            twin_runs.frame(twin_runs.image(state, noise_times=noise_times), k, pressure)
            for k, (state, pressure) in enumerate(zip(states, pressures, strict=True))
        ]
        found = follow(wide, twin_runs, write(tmp_path / "moved.h5", records), states, strain=False)
        for k in (2, 3):
            assert np.abs(coverage(found, k) - 0.68).max() <= 0.07, coverage(found, k)

    @pytest.mark.parametrize("noise_times", [1.0, 2.0])
    @pytest.mark.parametrize("third", [0, 1, 2])
    def test_in_each_third_of_the_volume(
        self, wide: Calibration, twin_runs: TwinRuns, tmp_path, third: int, noise_times: float
    ):
        depth_mm = wide.control.distorted_mm[:, 1]
        edges = np.linspace(depth_mm.min(), depth_mm.max(), 4)
        rest = twin_runs.inflated(REST_KPA)
        there = twin_runs.world.surface_positions(np.zeros((1, 2)), rest)[0, 1]
        shift_mm = (0.0, (edges[third] + edges[third + 1]) / 2.0 - there, 0.0)
        placed = rest.placement._replace(shift_mm=shift_mm)
        pressures = [REST_KPA, REST_KPA, 2.0, 4.0]
        states = [twin_runs.inflated(p)._replace(placement=placed) for p in pressures]
        records = [
            twin_runs.frame(twin_runs.image(state, noise_times=noise_times), k, pressure)
            for k, (state, pressure) in enumerate(zip(states, pressures, strict=True))
        ]
        found = follow(wide, twin_runs, write(tmp_path / "placed.h5", records), states, strain=False)
        displacements, positions = [], []
        for k in (2, 3):
            known, depths = found.known(k), found.truth_mm[k][:, 1]
            assert known.sum() > 1500
            assert ((depths > edges[third]) & (depths < edges[third + 1]))[known].mean() > 0.9
            off = np.abs(found.frames[k].displacement_mm - (found.truth_mm[k] - found.truth_mm[0]))
            displacements.append((off < found.frames[k].displacement_sigma_mm)[known])
            positions.append((np.abs(found.frames[k].xyz_mm - found.truth_mm[k]) < found.frames[k].sigma_mm)[known])
        for covered in (np.concatenate(displacements).mean(axis=0), np.concatenate(positions).mean(axis=0)):
            assert np.abs(covered - 0.68).max() <= 0.07, covered

    @pytest.mark.parametrize("noise_times", [1.0, 2.0])
    @pytest.mark.parametrize("third", [0, 1, 2])
    def test_in_each_third_of_its_own_depth_as_the_membrane_rises(self, noisy, third: int, noise_times: float):
        found, displacements, positions = noisy(noise_times), [], []
        for frame, truth in list(zip(found.frames, found.truth_mm, strict=True))[3:]:
            known = frame.valid & found.speckled
            low, high = np.quantile(truth[known, 1], [third / 3, (third + 1) / 3])
            here = known & (truth[:, 1] >= low) & (truth[:, 1] <= high)
            off = np.abs(frame.displacement_mm - (truth - found.truth_mm[0]))
            displacements.append((off < frame.displacement_sigma_mm)[here])
            positions.append((np.abs(frame.xyz_mm - truth) < frame.sigma_mm)[here])
        for covered in (np.concatenate(displacements).mean(axis=0), np.concatenate(positions).mean(axis=0)):
            assert np.abs(covered - 0.68).max() <= 0.07, covered


def test_shape_functions_of_the_tracking(inflated: Measured, wide: Calibration, twin_runs: TwinRuns, inflation_run):
    by = {"curved": inflated}
    for shape in ("affine", "quadratic"):
        by[shape] = follow(wide, twin_runs, inflation_run, strain=False, tracking_shape=shape)
        assert by[shape].measurement.header.parameters["tracking_shape"] == shape
    off = {shape: rms(found.error_uvw(-1)) for shape, found in by.items()}
    assert off["curved"][:2].max() < 0.5 * off["affine"][:2].max()  # first order's bias
    assert off["curved"][2] < 0.6 * off["quadratic"][2]  # second order's noise


def test_light_that_turns_with_the_surface(inflated: Measured, wide: Calibration, twin_runs: TwinRuns, inflation_run):
    uniform = follow(wide, twin_runs, inflation_run, strain=False, lighting="uniform")
    assert uniform.measurement.header.parameters["lighting"] == "uniform"
    radius = np.hypot(*inflated.material_mm.T)
    ring = (radius > 10.0) & (radius < 13.0)
    across = []
    for found in (inflated, uniform):
        truth = found.truth_mm[-1] - found.truth_mm[0]
        across.append(rms((found.frames[-1].displacement_mm - truth)[ring & found.known(-1)])[0])
    assert across[0] < 0.9 * across[1]
