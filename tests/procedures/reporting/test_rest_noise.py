"""Noise floors of frames at rest, against the noise that was put in."""

from types import SimpleNamespace

import numpy as np
import pytest

from bscd.procedures.reporting.rest_noise import rest_noise
from tests.procedures.reporting.rest_results import REST_KPA, SIGMA_MM, STRAIN_SIGMA, write_rest


def floors(tmp_path, rest, reference):
    pressures = [*[REST_KPA] * rest, 0.2, 1.0, 2.0]
    with write_rest(tmp_path / "results.h5", pressures, reference) as results:
        return rest_noise(SimpleNamespace(results=results))


@pytest.mark.parametrize(("rest", "reference", "frames"), [(12, 4, 8), (4, 4, 4)])
def test_any_measured_frame_has_the_noise_that_is_reported(tmp_path, rest, reference, frames):
    """Its own and the reference's: s sqrt(1 + 1/n), whichever frames were at hand."""
    noise, why = floors(tmp_path, rest, reference)
    assert why == ""
    assert noise.frames == frames
    assert np.allclose(noise.displacement_mm, SIGMA_MM * np.sqrt(1.0 + 1.0 / reference), rtol=0.04)
    assert np.allclose(noise.strain, STRAIN_SIGMA * np.sqrt(1.0 + 1.0 / reference), rtol=0.04)
    assert np.allclose(noise.temporal_mm, SIGMA_MM, rtol=0.04)
    assert np.allclose(noise.temporal_strain, STRAIN_SIGMA, rtol=0.04)


def test_it_says_which_frames_were_taken(tmp_path):
    noise, _ = floors(tmp_path, 12, 4)
    assert noise.basis == "8 frames at rest that the reference is not made of"
    (tmp_path / "results.h5").unlink()
    noise, _ = floors(tmp_path, 4, 4)
    assert noise.basis.startswith("the 4 frames that the reference is made of")
    assert "multiplied by 1.29" in noise.basis


def test_a_frame_in_which_the_ramp_has_begun_is_left_out(tmp_path):
    """Within the tolerance of rest the membrane may have begun to rise."""
    pressures = [*[REST_KPA] * 7, REST_KPA + 0.025, 0.5]
    with write_rest(tmp_path / "results.h5", pressures, 4) as results:
        noise, _ = rest_noise(SimpleNamespace(results=results))
    assert noise.frames == 3
    assert noise.displacement_mm[2] < 1.3 * SIGMA_MM[2]


@pytest.mark.parametrize("pressures", [[REST_KPA, 1.0, 2.0], [np.nan] * 4])
def test_without_static_frames_there_is_a_reason_instead(tmp_path, pressures):
    with write_rest(tmp_path / "results.h5", pressures, 1) as results:
        noise, why = rest_noise(SimpleNamespace(results=results))
    assert noise is None
    assert why == "fewer than two frames at rest; record some before the ramp"


def test_without_strains_there_is_no_strain_floor(tmp_path):
    lost = {"strain": lambda values: np.full_like(values["strain"], np.nan)}
    with write_rest(tmp_path / "results.h5", [REST_KPA] * 8 + [1.0], 4, **lost) as results:
        noise, _ = rest_noise(SimpleNamespace(results=results))
    assert noise.strain is None
    assert np.isfinite(noise.displacement_mm).all()
