"""Random poses, lightings and prisms on the digital twin, and how the dots found compare with its truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bscd.calibration.dots import GridFinding, SplitRegion, find_grid, find_split
from bscd.calibration.target import GridTarget
from drivers.twin.options import CubeOptions, LightOptions, PrismOptions, RestOptions, SensorOptions, TwinOptions
from drivers.twin.world import World

VIEWS = ("primary", "auxiliary", "biprism")


@dataclass(frozen=True)
class Comparison:
    """Errors ``(N, 2)`` px of the dots that are visible; counts of those missed, wrong, and found beyond."""

    name: str
    error_px: np.ndarray
    sigma_px: np.ndarray
    visible: int
    missed: int
    wrong: int
    beyond_px: np.ndarray


def random_world(seed: int) -> tuple[World, str, str]:
    """A twin in a random state: the world, the pose ("corner", "face") and the view."""
    rng = np.random.default_rng(seed)
    pose = ("corner", "face")[seed % 2]
    view = VIEWS[seed // 2 % 3]
    contrast = rng.uniform(60.0, 170.0) / 255.0
    level = rng.uniform(max(0.45, contrast + 0.1), 0.9)
    options = TwinOptions(
        light=LightOptions(
            level=level,
            ambient=rng.uniform(0.2, 0.8),
            lamp_azimuth_deg=(rng.uniform(-70, -20), rng.uniform(20, 70)),
            lamp_elevation_deg=rng.uniform(-20, 30),
            gradient_per_mm=tuple(rng.uniform(-0.004, 0.004, 3)),
            background=rng.uniform(0.02, 0.3),
            vignetting=rng.uniform(0.0, 0.15),
        ),
        cube=CubeOptions(paper=1.0, ink=1.0 - contrast / level),
        sensor=SensorOptions(blur_px=rng.uniform(0.5, 1.1), noise_grey=2.0, noise="gaussian"),
        prism=PrismOptions(
            tilt_deg=tuple(rng.uniform(-0.5, 0.5, 3)),
            edge_mm=(rng.uniform(-3, 3), -210.0 + rng.uniform(-3, 3), 0.0),
        ),
        rest=RestOptions(
            rotation_deg=(45.0 if pose == "corner" else 0.0) + rng.uniform(-3, 3),
            translation_mm=50.0 + 2.0 * rng.integers(-8, 9),
            jack_mm=70.0 if view == "biprism" else 5.0,
        ),
    )
    world = World(options)
    world.place("cube", shift_mm=tuple(rng.uniform(-2, 2, 3)), turn_deg=tuple(rng.uniform(-1.5, 1.5, 3)))
    return world, pose, view


def compare(finding: GridFinding, truth, name: str, pose: str) -> Comparison:
    """Hold a finding against the twin's truth of the same view."""
    dots = GridTarget().dots_per_face
    wanted = truth.visible if pose == "corner" else truth.visible & (truth.index < dots)
    place = {int(k): xy for k, xy in zip(truth.index, truth.xy_px, strict=True)}
    visible = set(truth.index[wanted].tolist())
    error = np.array([xy - place[int(k)] for k, xy in zip(finding.index, finding.xy_px, strict=True)])
    seen = np.array([int(k) in visible for k in finding.index])
    size = np.linalg.norm(error, axis=1)
    return Comparison(
        name,
        error[seen],
        finding.sigma_px[seen],
        len(visible),
        len(visible - set(finding.index.tolist())),
        int((~(size < 1.0)).sum()),
        size[~seen],
    )


def run_case(seed: int) -> list[Comparison]:
    """Expose, find and compare all views of one random case."""
    world, pose, view = random_world(seed)
    camera = "auxiliary" if view == "auxiliary" else "primary"
    image = world.expose(
        camera,
        exposure_s=world.options.sensor.nominal_exposure_s,
        gain_db=0.0,
        rng=np.random.default_rng(seed + 1),
    )
    truths = {t.side: t for t in world.dots(camera)}
    if view != "biprism":
        finding = find_grid(image, GridTarget(), pose)
        return [compare(finding, truths[0], f"{seed} {pose} {view}", pose)]
    split = find_split([image])
    results = []
    for half in ("left", "right"):
        finding = find_grid(image, GridTarget(), pose, region=SplitRegion(split, half))
        middle = finding.xy_px[:, 0].mean()
        side = min((-1, 1), key=lambda s: abs(np.nanmean(truths[s].xy_px[:, 0]) - middle))
        results.append(compare(finding, truths[side], f"{seed} {pose} {view} {half}", pose))
    return results
