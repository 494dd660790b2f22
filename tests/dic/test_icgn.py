"""The kernel, in all its instruction sets, against IC-GN as the papers have it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from bscd.dic import Status, prepare
from bscd.dic.library import InstructionSet, best_set, can_run
from bscd.dic.solver import PARAMETERS, SOLVED, Solved, SolverOptions, solve
from bscd.dic.spline import noise_energy
from tests.dic.motions import Affine, FloatArray, centre_of, rotation, translation
from tests.dic.plain_icgn import PlainImage, PlainMatch, basis, composed, match
from tests.dic.speckle_pairs import Speckle, digitise

SIZE = (120, 100)
CENTRE = centre_of(SIZE)
SETS = [
    pytest.param(s, marks=pytest.mark.skipif(not can_run(s), reason="this machine has no such instructions"))
    for s in (InstructionSet.BASELINE, InstructionSet.AVX2, InstructionSet.AVX512, InstructionSet.WIDE)
]
each_set = pytest.mark.parametrize("instructions", SETS, ids=lambda s: s.name.lower())
each_shape = pytest.mark.parametrize("shape", sorted(PARAMETERS))
each_spline = pytest.mark.parametrize("spline", ["cubic", "quintic"])

#: What the kernel's single precision may change at the subset's edge, px.
CLOSE_PX = 2e-4

MOTIONS = {
    "mild": Affine(((1.012, 0.02), (-0.017, 0.991)), (0.37, -0.62), CENTRE),
    "whole": translation(3.0, -2.0),
    "turned": rotation(24.0, SIZE),
    "stretched": Affine(((1.25, 0.1), (-0.08, 0.84)), (-1.3, 0.4), CENTRE),
}
MIDDLE = ((60.0, 50.0), (40.37, 61.82), (70.5, 30.5), (55.0, 44.25))
BORDER = ((10.0, 20.0), (3.2, 70.9), (112.7, 5.1), (116.0, 50.0), (60.0, 96.0), (20.5, 1.0))


def ring() -> NDArray[np.bool_]:
    rows, columns = np.indices(SIZE[::-1])
    distance = np.hypot(columns - CENTRE[0], rows - CENTRE[1])
    return (distance > 12) & (distance < 40)


def comb() -> NDArray[np.bool_]:
    rows, columns = np.indices(SIZE[::-1])
    return (columns % 4 != 1) | (rows % 7 == 3)


def wedge() -> NDArray[np.bool_]:
    rows, columns = np.indices(SIZE[::-1])
    return 3 * columns - 2 * rows > 55


MASKS = {"ring": ring, "comb": comb, "wedge": wedge}


@dataclass(frozen=True)
class Case:
    """What is matched: images by name, so that the plain solution is found once for all instruction sets."""

    motion: str = "mild"
    shape: str = "affine"
    spline: str = "quintic"
    subset_px: int = 21
    reference_mask: str | None = None
    current_mask: str | None = None
    contrast: tuple[float, float] = (1.0, 0.0)
    noise_grey: float = 0.0
    max_iterations: int = 50
    off_px: float = 0.4
    lighting: str = "uniform"

    @property
    def parameters(self) -> int:
        return PARAMETERS[self.shape]

    @property
    def fewest(self) -> int:
        return max(int(np.ceil(0.2 * self.subset_px**2)), self.parameters + 3)

    def guess(self, points: FloatArray) -> FloatArray:
        """The motion itself, but for some pixels."""
        shape = np.zeros((len(points), self.parameters))
        middle, right, down = (MOTIONS[self.motion].displacement_px(points + by) for by in ((0, 0), (1, 0), (0, 1)))
        half = self.parameters // 2
        for side in range(2):
            shape[:, side * half] = middle[:, side] + self.off_px * (-1) ** side
            shape[:, side * half + 1] = (right - middle)[:, side]
            shape[:, side * half + 2] = (down - middle)[:, side]
        if self.shape == "curved":
            shape[:, [3, 4, 5, 9, 10, 11]] = 1e-4 * np.array([3.0, -2.0, 5.0, -4.0, 1.0, 2.0])
        return shape

    def images(self) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        return pair(self.motion, self.contrast)

    def masks(self) -> list[NDArray[np.bool_] | None]:
        return [MASKS[name]() if name else None for name in (self.reference_mask, self.current_mask)]


@cache
def pair(motion: str, contrast: tuple[float, float]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    speckle, gain, offset = Speckle(seed=3, size_px=SIZE), *contrast
    current = gain * speckle.image(MOTIONS[motion]) + offset
    return (
        digitise(speckle.image(), 2.0, np.random.default_rng(1)),
        digitise(current, 2.0 * gain, np.random.default_rng(2)),
    )


@cache
def plain_image(motion: str, contrast: tuple[float, float], which: int, spline: str, mask: str | None) -> PlainImage:
    return PlainImage.of(pair(motion, contrast)[which], spline, MASKS[mask]() if mask else None)


@cache
def plain(case: Case, point: tuple[float, float]) -> PlainMatch:
    """The plain solution of one point."""
    reference, current = (
        plain_image(case.motion, case.contrast, which, case.spline, mask)
        for which, mask in enumerate((case.reference_mask, case.current_mask))
    )
    energy = noise_energy(case.spline)
    passed = []
    for along, across in (point, point[::-1]):
        slope, value = energy.derivative, energy.value
        passed.append((slope[0] + slope[1] * _wave(along)) * (value[0] + value[1] * _wave(across)))
    return match(
        reference,
        current,
        point,
        case.guess(np.array([point]))[0],
        subset_px=case.subset_px,
        max_iterations=case.max_iterations,
        fewest=case.fewest,
        noise_energy=(case.noise_grey**2 * passed[0], case.noise_grey**2 * passed[1]),
        solved=SOLVED[case.shape],
        lit=case.lighting == "linear",
    )


def _wave(place: float) -> float:
    return float(np.cos(2 * np.pi * place))


def kernel(case: Case, points: FloatArray, instructions: InstructionSet) -> Solved:
    reference, current = (
        prepare(image, mask=mask, interpolation=case.spline, subset_px=case.subset_px)
        for image, mask in zip(case.images(), case.masks(), strict=True)
    )
    options = SolverOptions(
        subset_px=case.subset_px,
        shape=case.shape,
        lighting=case.lighting,
        tolerance_px=1e-6,
        max_iterations=case.max_iterations,
        noise_grey=case.noise_grey,
        zncc_min=-1.0,
        sigma_max_px=1e3,
    )
    return solve(reference, current, points, case.guess(points), options, instructions=instructions)


def compare(case: Case, points: tuple[tuple[float, float], ...], instructions: InstructionSet) -> None:
    """All that the kernel says of the points against what the plain version says."""
    solved = kernel(case, np.array(points), instructions)
    reach = np.tile(basis(*np.full((2, 1), case.subset_px // 2), case.parameters // 2)[0], 2)
    for i, point in enumerate(points):
        wanted = plain(case, point)
        assert (solved.status[i] == Status.OUTSIDE) == (wanted.status == "outside"), point
        if wanted.status == "outside":
            continue
        # in single precision the last steps need not fall below 1e-6 px
        assert solved.status[i] in (Status.VALID, Status.NOT_CONVERGED), point
        got = {name: float(solved.column(name)[i]) for name in ("zncc", "gain", "residual_variance", "pixels")}
        covariance = np.array([[solved.column(name)[i] for name in row] for row in COVARIANCE])
        np.testing.assert_allclose(
            solved.shape[i] * reach, wanted.shape * reach, rtol=0, atol=CLOSE_PX, err_msg=f"{point}"
        )
        assert got["pixels"] == wanted.pixels, point
        assert got["zncc"] == pytest.approx(wanted.zncc, abs=3e-6), point
        assert got["gain"] == pytest.approx(wanted.gain, rel=1e-5), point
        # 1 - ZNCC keeps fewer digits the more similar the subsets are
        assert got["residual_variance"] == pytest.approx(
            wanted.residual_variance, rel=1e-3 + 3e-6 / (1 - wanted.zncc)
        ), point
        np.testing.assert_allclose(covariance, wanted.covariance, atol=2e-4 * np.max(wanted.covariance), rtol=0)


COVARIANCE = (("var_u", "cov_uv"), ("cov_uv", "var_v"))


@each_set
@each_spline
@each_shape
@pytest.mark.parametrize("motion", MOTIONS)
def test_the_solution_is_the_plain_one(instructions, spline, shape, motion):
    points = MIDDLE if motion != "mild" else MIDDLE + BORDER
    compare(Case(motion, shape, spline), points, instructions)


@each_set
@each_spline
@each_shape
@pytest.mark.parametrize("motion", ["mild", "turned"])
def test_one_iteration_is_the_plain_one(instructions, spline, shape, motion):
    compare(Case(motion, shape, spline, max_iterations=1, off_px=1.1), MIDDLE, instructions)


@each_set
@each_shape
@pytest.mark.parametrize("masks", [(None, None), ("comb", "wedge")], ids=["whole", "masked"])
def test_with_a_light_that_may_change_it_is_the_plain_one(instructions, shape, masks):
    case = Case("mild", shape, reference_mask=masks[0], current_mask=masks[1], off_px=0.2, lighting="linear")
    compare(case, MIDDLE[1:], instructions)


@each_set
@pytest.mark.parametrize("subset_px", [7, 9, 15, 17, 31, 33, 45])
def test_subsets_of_all_widths(instructions, subset_px):
    compare(Case(subset_px=subset_px), (*MIDDLE[:2], BORDER[0]), instructions)


@each_set
@each_shape
@pytest.mark.parametrize(
    "masks", [("ring", None), ("comb", None), (None, "wedge"), (None, "comb"), ("wedge", "ring"), ("comb", "wedge")]
)
def test_only_what_the_masks_allow_takes_part(instructions, shape, masks):
    points = ((60.0, 26.0), (38.0, 41.6), (80.4, 60.2), (36.5, 22.0), (27.5, 15.3), (60.0, 50.0))
    case = Case("mild", shape, reference_mask=masks[0], current_mask=masks[1], off_px=0.2)
    taken = [plain(case, point).pixels for point in points[:5] if plain(case, point).status == "valid"]
    assert len(taken) >= 2
    assert min(taken) < 0.95 * 21**2
    # where a mask leaves out a point itself, the plain version does not ask
    reference = plain_image(case.motion, case.contrast, 0, case.spline, case.reference_mask)
    allowed = [point for point in points if reference.usable(*np.array(point)[:, None])]
    compare(case, tuple(allowed), instructions)


@each_set
@each_shape
@pytest.mark.parametrize("contrast", [(0.5, 60.0), (1.1, -20.0)])
def test_gain_is_that_of_the_current_image(instructions, shape, contrast):
    case = Case("mild", shape, contrast=contrast)
    compare(case, MIDDLE, instructions)
    gain = kernel(case, np.array(MIDDLE), instructions).column("gain")
    np.testing.assert_allclose(gain, contrast[0], rtol=0.02)


@each_set
@each_shape
@each_spline
def test_the_noise_of_the_slopes_is_taken_off_the_hessian(instructions, shape, spline):
    case = Case("mild", shape, spline, noise_grey=3.0)
    compare(case, MIDDLE, instructions)
    without = kernel(Case("mild", shape, spline), np.array(MIDDLE), instructions)
    larger = kernel(case, np.array(MIDDLE), instructions).column("var_u") / without.column("var_u")
    assert np.all(larger > 1.01)


@each_set
def test_a_point_that_may_not_be_used_is_outside(instructions):
    points = np.array([(60.0, 50.0), (60.4, 38.6), (-0.1, 50.0), (50.0, 99.2), (60.0, 25.0)])
    solved = kernel(Case(reference_mask="ring"), points, instructions)
    outside = [Status.OUTSIDE] * 4
    assert list(solved.status[:4]) == outside
    assert solved.status[4] in (Status.VALID, Status.NOT_CONVERGED)
    assert np.isnan(solved.found[:4]).all()


@each_set
@pytest.mark.parametrize("columns, enough", [(5, True), (4, False)])
def test_a_fifth_of_the_subset_is_enough(instructions, columns, enough):
    case = Case(motion="whole", off_px=0.01)
    mask = np.zeros(SIZE[::-1], bool)
    mask[:, 58 : 58 + columns] = True
    reference, current = case.images()
    guess = case.guess(np.array([(60.0, 50.0)]))
    solved = solve(
        prepare(reference, mask=mask),
        prepare(current),
        np.array([(60.0, 50.0)]),
        guess,
        SolverOptions(sigma_max_px=9.0),
    )
    assert (solved.status[0] != Status.OUTSIDE) == enough
    if enough:
        assert solved.column("pixels")[0] == 21 * columns


@each_set
@each_shape
def test_points_do_not_depend_on_one_another(instructions, shape):
    rng = np.random.default_rng(4)
    points = rng.uniform((12, 12), (108, 88), (60, 2))
    reference, current = (prepare(image) for image in Case().images())
    guess, options = Case("mild", shape).guess(points), SolverOptions(shape=shape)
    together = solve(reference, current, points, guess, options, instructions=instructions)
    for i in (0, 17, 59):
        one = slice(i, i + 1)
        alone = solve(reference, current, points[one], guess[one], options, instructions=instructions)
        np.testing.assert_array_equal(alone.shape[0], together.shape[i])
        np.testing.assert_array_equal(alone.found[0], together.found[i])
        assert (alone.status[0], alone.iterations[0]) == (together.status[i], together.iterations[i])


def test_the_best_set_is_one_that_runs():
    assert can_run(best_set())
    case, points = Case(), np.array(MIDDLE)
    best, named = kernel(case, points, InstructionSet.BEST), kernel(case, points, best_set())
    np.testing.assert_array_equal(best.found, named.found)


@dataclass(frozen=True)
class Parabolas:
    """``u = shift + bend_xx X^2 / 2 + bend_xy X Y + bend_yy Y^2 / 2``, ``v = bend_v Y^2 / 2`` about the centre."""

    shift_px: float = 0.4
    bend_xx: float = 1.6e-3
    bend_xy: float = -1.1e-3
    bend_yy: float = 2.0e-3
    bend_v: float = -1.4e-3

    def displacement_px(self, points_px: FloatArray) -> FloatArray:
        x, y = (points_px - CENTRE).T
        across = self.shift_px + self.bend_xx * x * x / 2 + self.bend_xy * x * y + self.bend_yy * y * y / 2
        return np.column_stack([across, self.bend_v * y * y / 2])

    def material_px(self, columns_px: FloatArray, rows_px: FloatArray) -> tuple[FloatArray, FloatArray]:
        y = _root(self.bend_v, 1.0, np.asarray(rows_px, float) - CENTRE[1])
        moved = np.asarray(columns_px, float) - CENTRE[0] - self.shift_px - self.bend_yy * y * y / 2
        x = _root(self.bend_xx, 1.0 + self.bend_xy * y, moved)
        return x + CENTRE[0], y + CENTRE[1]

    def shape(self, points_px: FloatArray) -> FloatArray:
        """The shape parameters ``(N, 12)``, which are exact."""
        x, y = (points_px - CENTRE).T
        u, v = self.displacement_px(points_px).T
        same, none = np.ones(len(x)), np.zeros(len(x))
        slope_x, slope_y = self.bend_xx * x + self.bend_xy * y, self.bend_xy * x + self.bend_yy * y
        first = [u, slope_x, slope_y, self.bend_xx * same, self.bend_xy * same, self.bend_yy * same]
        return np.stack([*first, v, none, self.bend_v * y, none, none, self.bend_v * same], axis=1)


def _root(bend: float, slope: FloatArray | float, value: FloatArray) -> FloatArray:
    """t with ``slope t + bend t^2 / 2 = value``, the one near value / slope."""
    return 2 * value / (slope + np.sqrt(slope**2 + 2 * bend * value))


@each_set
@each_spline
def test_the_second_order_is_exact_on_a_quadratic_field(instructions, spline):
    speckle, motion = Speckle(seed=3, size_px=SIZE), Parabolas()
    points = np.array([(x, y) for x in (30.0, 52.3, 77.0, 90.0) for y in (28.0, 49.5, 70.0)])
    reference, current = (
        prepare(image.astype(np.float32), interpolation=spline) for image in (speckle.image(), speckle.image(motion))
    )
    truth, start, found = motion.shape(points), motion.displacement_px(points) + 0.3, {}
    for shape, parameters in PARAMETERS.items():
        guess = np.zeros((len(points), parameters))
        guess[:, [0, parameters // 2]] = start
        options = SolverOptions(shape=shape, max_iterations=60)
        found[shape] = solve(reference, current, points, guess, options, instructions=instructions)
        assert found[shape].valid.all()
    reach = np.tile(basis(np.array([10.0]), np.array([10.0]), 6)[0], 2)
    off = (found["quadratic"].shape - truth) * reach
    # what is left is the spline's: the cubic's is larger
    limit = {"quintic": 0.001, "cubic": 0.006}[spline]
    assert np.abs(off).max() < limit
    assert np.abs(found["affine"].shape[:, 0] - truth[:, 0]).max() > 0.05


@pytest.mark.parametrize("terms", [3, 6])
def test_the_plain_composition_undoes_what_it_is_given(terms):
    rng = np.random.default_rng(6)
    scale = np.tile([0.5, 0.02, 0.02, 1e-4, 1e-4, 1e-4][:terms], 2)
    p, d = rng.normal(0.0, scale), rng.normal(0.0, scale)
    both = composed(p, inverse_of=d)
    x, y = rng.uniform(-10, 10, (2, 50))

    def warped(shape, x, y):
        monomials = basis(x, y, terms)
        return x + monomials @ shape[:terms], y + monomials @ shape[terms:]

    # W(p) W(d)^-1 after W(d) is W(p); what the second order drops is of third order in small terms
    np.testing.assert_allclose(warped(both, *warped(d, x, y)), warped(p, x, y), atol=1e-12 if terms == 3 else 2e-3)
    np.testing.assert_allclose(composed(p, inverse_of=p), 0.0, atol=1e-12)
