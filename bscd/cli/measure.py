"""`bscd measure`: shape, displacement and strain of every frame of a run, offline."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from bscd.acquisition import PhaseName, RunFile
from bscd.acquisition.images import read_grey
from bscd.arrays import BoolArray
from bscd.calibration import Calibration
from bscd.cli.following import following
from bscd.dic.pool import DaskPool, LocalPool, Pool
from bscd.dic.solver import Lighting, ShapeName
from bscd.errors import InputError
from bscd.procedures.measuring import MeasureSettings, measure_to_file
from bscd.results import ResultsFile, StereoSource, count_points


def register(app: typer.Typer) -> None:
    """Add the command."""

    @app.command()
    def measure(
        calibration: Annotated[Path, typer.Argument(help="The calibration file.")],
        run: Annotated[Path, typer.Argument(help="Run file with sphere or inflation frames.")],
        out: Annotated[Path, typer.Option("-o", "--out", help="The results file to make; it must not exist.")],
        step: Annotated[int, typer.Option(min=1, help="Distance between points, px.")] = 10,
        subset: Annotated[int, typer.Option(min=5, help="Edge of the subset, px, odd.")] = 21,
        stereo: Annotated[StereoSource, typer.Option(help="Views: the biprism's halves, or both cameras.")] = "biprism",
        phase: Annotated[
            PhaseName | None, typer.Option(help="Frames to measure; default inflation, else sphere.")
        ] = None,
        region: Annotated[
            Path | None, typer.Option(help="Image that is white where points are wanted in the left view.")
        ] = None,
        stereo_shape: Annotated[ShapeName, typer.Option(help="Shape function of the stereo match.")] = "curved",
        tracking_shape: Annotated[ShapeName, typer.Option(help="Shape function of the tracking.")] = "curved",
        lighting: Annotated[
            Lighting, typer.Option(help="How light may change over a subset: by a gain, or linearly across it too.")
        ] = "linear",
        vsg: Annotated[float, typer.Option(help="Largest virtual strain gauge, mm.")] = 6.0,
        strain: Annotated[bool, typer.Option(help="Strains as well.")] = True,
        extrapolate: Annotated[bool, typer.Option(help="Keep points outside the calibrated hull, marked.")] = False,
        corrected: Annotated[bool, typer.Option(help="Correct the distortion; off: the virtual cameras alone.")] = True,
        threads: Annotated[
            int | None, typer.Option(min=1, help="Threads of the correlator; default: all cores.")
        ] = None,
        workers: Annotated[
            int | None, typer.Option(min=1, help="Worker processes that track, instead of threads of this one.")
        ] = None,
        dask: Annotated[
            str | None, typer.Option(metavar="ADDRESS", help="Track on a Dask cluster: its scheduler, tcp://host:8786.")
        ] = None,
        report: Annotated[Path | None, typer.Option(help="Also write a report.html with figures here.")] = None,
    ) -> None:
        """Measure a run: DIC and 3D for every frame.

        Example: bscd measure calibration.h5 inflation.h5 -o result.h5
        """
        if workers is not None and dask is not None:
            raise typer.BadParameter("give either --workers or --dask")
        if out.exists():
            raise InputError(f"{out}: exists already; results are never overwritten, choose another name")
        if report is not None:
            from bscd.offline.report import check_report_folder  # with the figures' libraries, half a second

            check_report_folder(report)
        settings = MeasureSettings(
            step_px=step,
            subset_px=subset,
            stereo=stereo,
            phase=phase,
            region=None if region is None else _region(region),
            stereo_shape=stereo_shape,
            tracking_shape=tracking_shape,
            lighting=lighting,
            vsg_mm=vsg,
            strain=strain,
            extrapolate=extrapolate,
            corrected=corrected,
            threads=threads,
        )
        loaded = Calibration.load(calibration)
        warnings: list[str] = []

        def warn(text: str) -> None:
            warnings.append(text)
            _warn(text)

        with (
            RunFile(run) as source,
            _pool(workers, dask, threads) as pool,
            following("Measuring", "frames") as progress,
        ):
            header = measure_to_file(
                loaded,
                source,
                out,
                settings,
                calibration_name=calibration.name,
                progress=progress,
                warn=warn,
                pool=pool,
            )
        with ResultsFile(out) as results:
            counts = count_points(results.frames())
            frames = f"{len(results)} {header.parameters['phase']} frames"
        typer.echo(f"{out}: {frames} of {len(header.points_px)} points: {counts.text(header.status_names)}")
        if report is not None:
            from bscd.offline.report import report_measurement

            with RunFile(run) as source, following("Measuring by the pair", "frames") as progress:
                page = report_measurement(
                    loaded, source, out, settings, report, warnings=warnings, warn=_warn, progress=progress
                )
            typer.echo(f"{page}")


def _region(path: Path) -> BoolArray:
    """Where the image is not black, ``(H, W)``."""
    try:
        return read_grey(path).data > 0
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


@contextmanager
def _pool(workers: int | None, dask: str | None, threads: int | None) -> Iterator[Pool | None]:
    """The workers that were asked for; None: none."""
    if workers is None and dask is None:
        yield None
        return
    with LocalPool(workers, threads=threads) if workers is not None else DaskPool(str(dask)) as pool:
        yield pool


def _warn(text: str) -> None:
    typer.echo(f"warning: {text}", err=True)
