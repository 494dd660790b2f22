"""Numbers as text: rounded sensibly, a word where a number is not known."""

from __future__ import annotations

import math

from bscd.analysis.validation import ErrorFigure

UNKNOWN = "not known"
MINUS = "\N{MINUS SIGN}"


def number(value: float, digits: int = 3) -> str:
    """A number with so many significant digits, without an exponent between 1e-5 and 1e7."""
    if not math.isfinite(value):
        return UNKNOWN
    if value == 0.0:
        return "0"
    if not 1e-5 <= abs(value) < 1e7:
        return f"{value:.{digits - 1}e}".replace("-", MINUS)
    return f"{value:.{_decimals(value, digits)}f}".replace("-", MINUS)


def mean_and_std(figure: ErrorFigure) -> str:
    """Mean ± standard deviation: the smaller with two significant digits, between 0.001 and 0.00001."""
    if figure.count == 0 or not math.isfinite(figure.mean_mm + figure.std_mm):
        return UNKNOWN
    mean, std = abs(figure.mean_mm), figure.std_mm
    smaller = min(mean, std) or max(mean, std)
    decimals = min(max(_decimals(smaller, 2), 3), 5) if smaller > 0.0 else 3
    return f"{figure.mean_mm:.{decimals}f} ± {std:.{decimals}f}".replace("-", MINUS)


def duration(seconds: float) -> str:
    """Hours, minutes and seconds."""
    if not math.isfinite(seconds):
        return UNKNOWN
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{number(seconds, 2)} s"


def _decimals(value: float, digits: int) -> int:
    """Decimal places that show so many significant digits of a number."""
    return max(digits - 1 - math.floor(math.log10(abs(value))), 0)
