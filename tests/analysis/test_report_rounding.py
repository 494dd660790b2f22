import math

import pytest

from bscd.analysis.report.rounding import duration, mean_and_std, number
from bscd.analysis.validation import ErrorFigure


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.0, "0"),
        (0.0327123, "0.0327"),
        (-12.345, "\u221212.3"),
        (1234.5, "1234"),
        (0.999999, "1.000"),
        (math.nan, "not known"),
        (math.inf, "not known"),
        (3.2e-9, "3.20e\u221209"),
    ],
)
def test_numbers(value, shown):
    assert number(value) == shown


@pytest.mark.parametrize(
    ("mean", "std", "shown"),
    [
        (0.00641, 0.00472, "0.0064 ± 0.0047"),
        (0.1764, 0.1062, "0.176 ± 0.106"),
        (0.021, 0.032, "0.021 ± 0.032"),
        (0.5, 0.0, "0.500 ± 0.000"),
        (0.0, 0.0, "0.000 ± 0.000"),
        (0.8062, 0.000417, "0.80620 ± 0.00042"),
    ],
)
def test_mean_and_std(mean, std, shown):
    assert mean_and_std(ErrorFigure(mean, std, 10)) == shown


def test_a_figure_of_nothing():
    assert mean_and_std(ErrorFigure(math.nan, math.nan, 0)) == "not known"


@pytest.mark.parametrize(("seconds", "shown"), [(0.84, "0.84 s"), (83.4, "1 min 23 s"), (3723, "1 h 02 min")])
def test_durations(seconds, shown):
    assert duration(seconds) == shown
