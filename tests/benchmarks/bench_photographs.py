"""Our matches on MultiDIC's photographs beside its own, as a table; ``--pictures DIR`` draws them.

``scripts/bench photographs``; the figures and pictures of docs/photographs.md come from here.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

import cv2
import numpy as np

from bscd.dic.solver import ShapeName
from tests.benchmarks.dic.photograph_figures import cylinder_figure, views_figure
from tests.benchmarks.dic.photograph_outlines import outline_radius_mm
from tests.benchmarks.dic.photographs import (
    FRAMES,
    LEFT,
    RIGHT,
    SUBSET_PX,
    Photographs,
    Positions,
    apart_px,
    fit_cylinder,
    rigid_residual_mm,
)

#: Shape functions and subsets that are compared.
WAYS: tuple[tuple[ShapeName, int], ...] = (
    ("affine", 37),
    ("affine", 21),
    ("curved", 37),
    ("curved", 21),
    ("quadratic", 37),
    ("quadratic", 31),
)

#: Subsets over which the bias of first order is shown.
BIASED_PX = (21, 27, 31, 37, 43)

COLUMNS = "| matches | points | left, px | right, px | radius, mm | off it, mm | rigid, um |"


def row(name: str, photographs: Photographs, positions: Positions) -> str:
    """One line of the table."""
    stored = photographs.stored
    apart = {c: np.concatenate([apart_px(positions[c, k], stored[c, k]) for k in FRAMES[1:]]) for c in (LEFT, RIGHT)}
    surfaces = [photographs.surface(positions, k) for k in FRAMES]
    cylinders = [fit_cylinder(surface) for surface in surfaces]
    rigid = rigid_residual_mm(surfaces[0], surfaces[-1]).std(axis=0)
    found = min(np.isfinite(surface).all(axis=1).sum() for surface in surfaces)
    cells = [
        name,
        f"{found}",
        *(f"{np.median(a):.4f} / {np.quantile(a, 0.95):.3f} / {a.max():.2f}" for a in apart.values()),
        f"{cylinders[0].radius_mm:.3f} to {cylinders[-1].radius_mm:.3f}",
        f"{cylinders[0].std_mm:.3f}",
        " ".join(f"{1000.0 * each:.0f}" for each in rigid),
    ]
    return "| " + " | ".join(cells) + " |"


def pictures(photographs: Photographs, ours: Positions, folder: Path) -> None:
    """Write the two pictures."""
    second = photographs.matched("quadratic", 31, frames=1)[RIGHT, 1]

    def bias_px(positions: Positions) -> float:
        return float(np.nanmean((positions[RIGHT, 1] - second)[:, 0]))

    biases = {subset_px: bias_px(photographs.matched("affine", subset_px, frames=1)) for subset_px in BIASED_PX}
    print("bias of first order, px:", ", ".join(f"{key}: {value:.3f}" for key, value in biases.items()))
    print(f"bias of MultiDIC's matches, px: {bias_px(photographs.stored):.3f}")
    drawn = {
        "photographs.png": views_figure(photographs, ours),
        "photographs-cylinder.png": cylinder_figure(photographs, ours, biases, bias_px(photographs.stored)),
    }
    for name, figure in drawn.items():
        figure.savefig(folder / name, dpi=80, facecolor="white")
        picture = cv2.imread(str(folder / name))
        assert picture is not None
        cv2.imwrite(str(folder / name), picture // 16 * 17, [cv2.IMWRITE_PNG_COMPRESSION, 9])  # small, for a page


def main(arguments: list[str] | None = None) -> int:
    """Print the table; draw the pictures where they are asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--pictures", type=Path, metavar="DIR")
    asked = parser.parse_args(arguments)
    folder = Path(os.environ.get("BSCD_DATA", Path(__file__).resolve().parents[3] / "shared/data"))
    if not folder.is_dir():
        print(f"bench: no real images at {folder}; set BSCD_DATA", file=sys.stderr)
        return 1
    photographs = Photographs.load(folder)
    print(COLUMNS, "| --- " * 7 + "|", row("MultiDIC", photographs, photographs.stored), sep="\n")
    for shape, subset_px in WAYS:
        found = photographs.matched(shape, subset_px)
        print(row(f"bscd {shape} {subset_px}", photographs, found))
        if asked.pictures and (shape, subset_px) == ("affine", SUBSET_PX):
            pictures(photographs, found, asked.pictures)
    for name, path in (("calibration", "multidic-dlt/{0}.jpg"), ("speckled", "multidic-speckle/{0}/{0}_1.jpg")):
        files = {
            camera: cv2.imread(str(folder / path.format(camera)), cv2.IMREAD_GRAYSCALE) for camera in (LEFT, RIGHT)
        }
        seen = {camera: np.asarray(image, float) for camera, image in files.items() if image is not None}
        print(f"radius of the {name} cylinder by its outlines: {outline_radius_mm(photographs.matrices, seen):.2f} mm")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
