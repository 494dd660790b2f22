"""`bscd design` against Snell's law worked out by hand in the plane."""

import math
import re

import cv2
import pytest
import typer
from scipy.optimize import brentq
from typer.testing import CliRunner

from bscd.cli.design import register
from bscd.errors import InputError


@pytest.fixture
def app():
    app = typer.Typer()
    app.callback()(lambda: None)
    register(app)
    return app


def invoke(app, *arguments):
    return CliRunner().invoke(app, ["design", *arguments], env={"COLUMNS": "120"})


def value(text, name):
    return float(re.search(rf"{name}\W+(-?[\d.]+)", text)[1])


def landing_mm(angle, n, alpha_deg, s, d_o, d_c):
    """(x at the object, angle to the axis there) of a ray that leaves the camera at an angle to the axis."""
    beta = math.radians(180.0 - alpha_deg) / 2.0
    inside = math.asin(math.sin(angle) / n)
    x_back = d_c * math.tan(angle)
    # roof: x tan(beta) below the edge plane at x > 0
    x_roof = (x_back + s * math.tan(inside)) / (1.0 + math.tan(inside) * math.tan(beta))
    outside = math.asin(n * math.sin(inside - beta)) + beta
    return x_roof + (d_o + x_roof * math.tan(beta)) * math.tan(outside), outside


@pytest.mark.parametrize("d_o", [150.0, 210.0])
@pytest.mark.parametrize("alpha", [161.4, 168.0])
def test_stereo_angle_and_views_follow_from_snell(app, alpha, d_o):
    done = invoke(app, "--alpha-deg", f"{alpha}", "--d-o-mm", f"{d_o}")
    assert done.exit_code == 0, done.output
    geometry = (1.4585, alpha, 30.0, d_o, 382.0)
    middle = brentq(lambda angle: landing_mm(angle, *geometry)[0], 1e-4, 0.15)
    assert value(done.output, "Stereo angle in the middle of the object") == pytest.approx(
        2 * abs(math.degrees(landing_mm(middle, *geometry)[1])), abs=0.006
    )
    border = math.atan(640.0 * 0.0067 / 75.0)
    ends = landing_mm(1e-9, *geometry)[0], landing_mm(border, *geometry)[0]
    assert value(done.output, "Width that each view sees") == pytest.approx(ends[1] - ends[0], abs=0.06)
    both = 2 * min(-ends[0], ends[1])
    assert value(done.output, "Width that both views see") == pytest.approx(both, abs=0.06)


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_it_draws(app, tmp_path, suffix):
    path = tmp_path / f"rig.{suffix}"
    done = invoke(app, "--out", str(path))
    assert done.exit_code == 0, done.output
    if suffix == "png":
        assert cv2.imread(str(path)).std() > 5.0
    else:
        text = path.read_text()
        assert "d_o = 210 mm" in text
        assert "Stereo angle" in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--sensor-px", "1280"), "columns x rows"),
        (("--out", "rig.pdf"), "a .svg or a .png"),
        (("--out", "nowhere/rig.png"), "no folder nowhere"),
        (("--s-mm", "1"), "too thin"),
        (("--alpha-deg", "185"), "90..180"),
        (("--d-c-mm", "-3"), "above 0"),
    ],
)
def test_bad_input_is_one_sentence(app, arguments, words):
    done = invoke(app, *arguments)
    assert isinstance(done.exception, InputError)
    assert words in str(done.exception)
    assert "\n" not in str(done.exception)
