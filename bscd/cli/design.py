"""`bscd design`: what a biprism, a lens and two distances give, before anything is bought."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from bscd.errors import InputError
from drivers.twin.design import RigDesign, design_rig

_BEYOND_MM = 25.0
_FORMATS = (".svg", ".png")


def register(app: typer.Typer) -> None:
    """Add the command."""

    @app.command()
    def design(
        n: Annotated[
            float, typer.Option("--n", help="Refractive index of the prism at the light's wavelength.")
        ] = 1.4585,
        alpha_deg: Annotated[float, typer.Option(help="Apex angle of the prism's roof, deg.")] = 161.4,
        s_mm: Annotated[float, typer.Option(help="Thickness of the prism, back face to roof edge, mm.")] = 30.0,
        lens_mm: Annotated[float, typer.Option(help="Pinhole distance of the lens at this focus, mm.")] = 75.0,
        sensor_px: Annotated[str, typer.Option(help="Columns x rows of the sensor, px.")] = "1280x1024",
        pixel_mm: Annotated[float, typer.Option(help="Edge of a pixel, mm.")] = 0.0067,
        d_o_mm: Annotated[float, typer.Option(help="d_o: roof edge to object, mm.")] = 210.0,
        d_c_mm: Annotated[float, typer.Option(help="d_c: centre of projection to the back face, mm.")] = 382.0,
        out: Annotated[Path | None, typer.Option(help="Also draw it, to a .svg or .png file.")] = None,
    ) -> None:
        """Trace a rig exactly and print its stereo angle, views, overlap and the prism that it needs.

        Example: bscd design --alpha-deg 165 --d-o-mm 180 --out rig.svg
        """
        width_px, height_px = _sensor(sensor_px)
        if out is not None:
            _check_drawing(out)
        try:
            rig = design_rig(
                refractive_index=n,
                alpha_deg=alpha_deg,
                thickness_mm=s_mm,
                focal_length_mm=lens_mm,
                pixel_size_mm=pixel_mm,
                width_px=width_px,
                height_px=height_px,
                object_distance_mm=d_o_mm,
                camera_distance_mm=d_c_mm,
            )
        except ValueError as err:
            raise InputError(f"design: {err}") from err
        Console().print(design_table(rig))
        if out is not None:
            draw_design(rig, out)
            typer.echo(f"drawn to {out}")


def design_rows(rig: RigDesign) -> list[tuple[str, str]]:
    """Name and value with its unit, in the order of the table."""
    return [
        ("Stereo angle in the middle of the object", f"{rig.stereo_angle_deg:.2f} deg"),
        ("Width that each view sees", f"{rig.half_view_width_mm:.1f} mm"),
        ("Width that both views see", f"{rig.overlap_width_mm:.1f} mm"),
        ("Height that both views see", f"{rig.view_height_mm:.1f} mm"),
        ("Image of a millimetre across", f"{rig.magnification_px_per_mm:.2f} px"),
        ("Depth per pixel of disparity", f"{rig.depth_per_px_mm:.4f} mm"),
        ("Prism width needed", f"{rig.prism_width_mm:.1f} mm"),
        ("Prism height needed", f"{rig.prism_height_mm:.1f} mm"),
        ("Travel that takes it out of the view", f"{rig.prism_travel_mm:.1f} mm"),
    ]


def design_table(rig: RigDesign) -> Table:
    """The design as a table for the terminal."""
    table = Table(title="Biprism rig by the exact trace", title_justify="left", show_header=False)
    table.add_column("quantity")
    table.add_column("value", justify="right")
    for row in design_rows(rig):
        table.add_row(*row)
    return table


def draw_design(rig: RigDesign, path: Path) -> None:
    """Draw the rig from above to a new or existing ``.svg`` or ``.png`` file."""
    from bscd.analysis.figures import RigDrawing, draw_rig, house_style

    # a ray runs on as straight as it left the roof
    rays = [np.vstack([ray, ray[-1] + _BEYOND_MM * _heading(ray)]) for ray in rig.rays_xy_mm]
    half = len(rays) // 2
    camera, edge_y = rays[0][0], float(rig.prism_outline_xy_mm[0, 1])
    back_y = float(rig.prism_outline_xy_mm[:, 1].min())
    shown = design_rows(rig)
    drawing = RigDrawing(
        camera_mm=camera,
        prism_mm=rig.prism_outline_xy_mm,
        rays_mm={"left": rays[:half], "right": rays[half:]},
        dimensions=(("d_c", float(camera[1]), back_y), ("d_o", edge_y, 0.0)),
        facts=tuple(f"{name}: {value}" for name, value in (shown[0], shown[2], shown[5])),
    )
    with house_style():
        draw_rig(drawing).savefig(path, dpi=150, facecolor="white")


def _heading(ray: np.ndarray) -> np.ndarray:
    """Direction of the last leg per mm of y."""
    leg = ray[-1] - ray[-2]
    return leg / leg[1]


def _sensor(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"\s*(\d+)\s*[xX\N{MULTIPLICATION SIGN}]\s*(\d+)\s*", text)
    if match is None or min(int(match[1]), int(match[2])) < 1:
        raise InputError(f"--sensor-px {text!r}: give columns x rows, for example 1280x1024")
    return int(match[1]), int(match[2])


def _check_drawing(path: Path) -> None:
    if path.suffix.lower() not in _FORMATS:
        raise InputError(f"--out {path}: a drawing is a .svg or a .png file")
    if not path.parent.is_dir():
        raise InputError(f"--out {path}: there is no folder {path.parent}; make it first")
