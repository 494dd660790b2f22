"""A measured inflation as a report tells it: a few maps, a value a frame, noise floors at rest."""

from __future__ import annotations

import numpy as np

from bscd.analysis.report.measurement import InflationData, InflationMap, InflationSeries
from bscd.arrays import FloatArray, IntArray
from bscd.procedures.reporting.rest_noise import rest_noise
from bscd.procedures.reporting.source import Source, known
from bscd.procedures.reporting.sphere import counts_in_words
from bscd.results import FrameResult

#: Shown are the frames nearest to these shares of the highest pressure; 13 of the paper's 16 kPa is among them.
_SHARES = (0.25, 0.5, 0.8125, 1.0)

#: "The middle" are the points within this part of the measured radius about the membrane frame's origin.
_MIDDLE = 0.1
_LEAST_MIDDLE = 5


def inflation_data(source: Source, truth_w_rms_mm: FloatArray | None = None) -> InflationData | None:
    """What a report tells of an inflation; None where the results have no membrane frame."""
    results = source.results
    frame, count = results.header.membrane, len(results)
    if frame is None or not count:
        return None
    places = _places_mm(source)
    middle = _middle(places)
    columns = np.full((5, count), np.nan)
    wanted = set(chosen_frames(results.array("pressure_kpa")).tolist())
    maps: list[InflationMap] = []
    measured: list[FrameResult] = []
    for place, one in enumerate(results.frames()):
        w, e1 = known(one.uvw_mm, one.valid)[:, 2], known(np.asarray(one.principal, float), one.valid)[:, 0]
        columns[:, place] = (_mean(w[middle]), _largest(w), _mean(e1[middle]), _largest(e1), one.valid.sum())
        if place in wanted:
            maps.append(_map(one))
            measured.append(one)
    noise, why = rest_noise(source)
    time_s = results.array("time_s")
    return InflationData(
        places_mm=places,
        maps=tuple(maps),
        series=InflationSeries(results.frame_numbers().astype(float), time_s, results.array("pressure_kpa"), *columns),
        noise=noise,
        why_no_noise=why,
        counts=counts_in_words(source, measured[-1]),
        frames_lost=lost_frames(source.rows()),
        reference_frames=results.header.reference_frames,
        frames_per_s=frame_rate_hz(time_s),
        truth_w_rms_mm=truth_w_rms_mm,
    )


def chosen_frames(pressure_kpa: FloatArray) -> IntArray:
    """Places of the frames whose maps are shown: nearest to shares of the highest pressure, else evenly spaced."""
    count = len(pressure_kpa)
    if not np.isfinite(pressure_kpa).any():
        return np.unique(np.rint(np.array(_SHARES) * (count - 1)).astype(int))
    top = np.nanmax(pressure_kpa)
    miss = [np.where(np.isfinite(pressure_kpa), np.abs(pressure_kpa - share * top), np.inf) for share in _SHARES]
    return np.unique([int(np.argmin(one)) for one in miss])


def frame_rate_hz(time_s: FloatArray) -> float:
    """Frames a second from the times of frames ``(T,)``: the median interval's; NaN where they are not known."""
    intervals = np.diff(time_s)
    intervals = intervals[np.isfinite(intervals) & (intervals > 0.0)]
    return float(1.0 / np.median(intervals)) if intervals.size else float("nan")


def lost_frames(rows: np.ndarray) -> int:
    """Exposures that the frames' numbers leave out between the first and the last of a run's rows."""
    numbers = rows["frame_id"].astype(np.int64)
    return int(np.maximum(np.diff(numbers) - 1, 0).sum())


def _places_mm(source: Source) -> FloatArray:
    """x', y' ``(N, 2)`` of the points in the reference: position less displacement, from the first frame that knows."""
    frame = source.results.header.membrane
    places = np.full((len(source.results.points_px), 2), np.nan)
    if frame is None:
        return places
    for one in source.results.frames():
        missing = np.isnan(places[:, 0])
        at_rest = (one.xyz_mm - one.displacement_mm - frame.origin_mm) @ frame.axes.T
        places[missing] = at_rest[missing, :2]
        if one.number > max(source.results.header.reference_frames, default=0):
            break
    return places


def _middle(places_mm: FloatArray) -> np.ndarray:
    """Places in the list of the points about the origin."""
    distance = np.hypot(*places_mm.T)
    if not np.isfinite(distance).any():
        return np.zeros(0, int)
    near = np.flatnonzero(distance <= _MIDDLE * np.nanmax(distance))
    return near if len(near) >= _LEAST_MIDDLE else np.argsort(np.nan_to_num(distance, nan=np.inf))[:_LEAST_MIDDLE]


def _map(one: FrameResult) -> InflationMap:
    shown = one.valid | one.extrapolated
    return InflationMap(
        number=one.number,
        pressure_kpa=one.pressure_kpa,
        uvw_mm=known(one.uvw_mm, shown),
        principal=known(np.asarray(one.principal, float), one.valid),
        sigma_mm=known(np.asarray(one.displacement_sigma_mm, float), shown),
        epipolar_px=np.asarray(one.epipolar_px, float),
        valid=one.valid,
        extrapolated=one.extrapolated,
    )


def _mean(values: FloatArray) -> float:
    values = values[np.isfinite(values)]
    return float(values.mean()) if values.size else float("nan")


def _largest(values: FloatArray) -> float:
    values = values[np.isfinite(values)]
    return float(values.max()) if values.size else float("nan")
