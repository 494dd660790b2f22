"""The report of a measurement: from the results and their run to a page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from bscd.acquisition import RunFile
from bscd.analysis.report import MeasurementReport, write_measurement_report
from bscd.calibration import Calibration
from bscd.config import parse_target
from bscd.errors import InputError
from bscd.offline.setup_facts import setup_facts
from bscd.procedures import ProgressCallback
from bscd.procedures.measuring import MeasureSettings, measure_to_file
from bscd.procedures.reporting import Source, gather_measurement
from bscd.results import ResultsFile


def check_report_folder(folder: Path) -> None:
    """Raise `InputError` when a report can not go there, before anything is measured."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; name a folder for the report")


def report_measurement(
    calibration: Calibration,
    run: RunFile,
    results_path: Path,
    settings: MeasureSettings,
    folder: Path,
    *,
    warnings: Sequence[str] = (),
    warn: Callable[[str], None],
    progress: ProgressCallback | None = None,
) -> Path:
    """Write the report of a results file; the page's path.

    Where the run holds the same sphere by the standard pair, that is measured as well, with the same settings, for
    the report alone; ``progress`` is that measurement's.
    """
    told = list(warnings)

    def say(text: str) -> None:
        told.append(text)
        warn(text)

    facts: dict[str, str] = {}
    radius_mm = None
    try:
        target = parse_target(run.config_text, f"{run.path}, configuration")
        facts = setup_facts(run.config_text)
        radius_mm = None if target.sphere is None else target.sphere.radius_mm
    except InputError as error:
        say(f"the run's configuration tells nothing: {error}")
    with ExitStack() as opened:
        results = opened.enter_context(ResultsFile(results_path))
        sources = [Source(results, run, calibration)]
        if sources[0].phase == "sphere" and results.header.stereo == "biprism" and "auxiliary" in run.cameras:
            beside = Path(opened.enter_context(TemporaryDirectory())) / "standard.h5"
            try:
                _measure_pair(calibration, run, beside, settings, progress)
            except InputError as error:
                say(f"the standard pair is not shown: {error}")
            else:
                sources.append(Source(opened.enter_context(ResultsFile(beside)), run, calibration))
        data = gather_measurement(sources, sphere_radius_mm=radius_mm, facts=facts)
        header = results.header
        report = MeasurementReport(
            title=header.title[:1].upper() + header.title[1:],
            made=f"Measured {header.start_time} by bscd {header.program_version}, {len(results)} frames",
            data=data,
            origins=(
                (run.path.name, run.uuid, run.checksum),
                (header.calibration.file_name or "calibration", "", calibration.checksum),
                (results_path.name, results.uuid, results.checksum),
            ),
            warnings=tuple(told),
            config_text=run.config_text,
            parameters=dict(header.parameters),
        )
        return write_measurement_report(report, folder)


def _measure_pair(
    calibration: Calibration, run: RunFile, path: Path, settings: MeasureSettings, progress: ProgressCallback | None
) -> None:
    """The same sphere by both cameras; the region, if one was given, is of the view through the biprism."""
    chosen = replace(settings, stereo="standard", phase="sphere", region=None)
    measure_to_file(calibration, run, path, chosen, progress=progress)
