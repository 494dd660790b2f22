"""Results of a flat membrane with known noise, whose reference is the mean of its first frames."""

from pathlib import Path

import numpy as np

from bscd.results import FrameResult, MembraneFrame, Origin, ResultsFile, ResultsHeader, ResultsWriter

REST_KPA = 0.05
SIDE = 40
STRAIN_SIGMA = 2e-4
SIGMA_MM = np.array([1e-3, 2e-3, 8e-3])


def write_rest(path: Path, pressure_kpa, reference: int, seed: int = 3, **changes) -> ResultsFile:
    """Frames at these pressures: noise of `SIGMA_MM`, less the mean noise of the first ``reference`` frames.

    w rises by 1 mm a kPa in the middle, falling to nothing at the corners.
    """
    rng = np.random.default_rng(seed)
    column, row = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
    points = np.stack([column.ravel(), row.ravel()], axis=1) * 10.0 + 100.0
    places = (points - points.mean(axis=0)) * 0.05
    rest = np.column_stack([places[:, 0], np.full(len(places), 8.0), -places[:, 1]])
    count = len(pressure_kpa)
    noise = rng.normal(size=(count, len(points), 3)) * SIGMA_MM
    noise -= noise[:reference].mean(axis=0)
    strain = rng.normal(size=(count, len(points), 3)) * STRAIN_SIGMA
    strain -= strain[:reference].mean(axis=0)
    bell = 1.0 - np.sum((places / np.abs(places).max(axis=0)) ** 2, axis=1) / 2.0
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    header = ResultsHeader(
        title="membrane",
        run=Origin("run.h5", "", ""),
        calibration=Origin("", "", ""),
        points_px=points,
        status_names={0: "valid", 4: "low_zncc", 9: "outside_volume"},
        reference_frames=tuple(range(reference)),
        membrane=MembraneFrame(np.array([0.0, 8.0, 0.0]), axes),
        parameters={"phase": "inflation", "step_px": 10, "subset_px": 21},
    )
    with ResultsWriter(path, header) as writer:
        for k, pressure in enumerate(pressure_kpa):
            uvw = noise[k] + np.column_stack([np.zeros((len(points), 2)), bell * (pressure - REST_KPA)])
            values = {
                "displacement_mm": uvw @ axes,
                "xyz_mm": rest + uvw @ axes,
                "uvw_mm": uvw,
                "strain": strain[k],
                "principal": np.column_stack([0.01 * pressure * bell, 0.005 * pressure * bell]),
                "sigma_mm": np.tile(SIGMA_MM, (len(points), 1)),
                "displacement_sigma_mm": np.tile(SIGMA_MM, (len(points), 1)),
                "epipolar_px": np.full(len(points), 0.01),
                "zncc": np.ones(len(points)),
                "status": np.zeros(len(points), np.uint8),
            }
            blank = FrameResult.unknown(k, len(points), 0, time_s=k / 11.0, pressure_kpa=float(pressure))
            known = {name: getattr(blank, name) for name in FrameResult.__slots__} | values
            writer.append(FrameResult(**(known | {name: change(known) for name, change in changes.items()})))
    return ResultsFile(path)
