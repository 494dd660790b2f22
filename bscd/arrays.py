"""Array types that the numerical packages share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.floating]
"""Real numbers; float64 unless a docstring says otherwise."""

AnalyticArray = NDArray[np.inexact]
"""Real numbers, or complex ones where a function also serves derivatives by a complex step."""

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
