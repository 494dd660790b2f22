"""Recipes that need no rig."""

from __future__ import annotations

from bscd.calibration import Calibration
from bscd.daemon.recipes import Calibrate, Measure
from bscd.daemon.running.desk import do_at_the_desk
from bscd.daemon.running.tasks import CalibrateTask, MeasureTask
from bscd.daemon.running.work import Work
from bscd.procedures.measuring import MeasureSettings


def run_calibrate(recipe: Calibrate, work: Work) -> None:
    """Calibrate; its figures are the calibration's."""
    task = CalibrateTask(
        work.given("run", recipe.reference),
        work.given("run", recipe.bsc),
        work.making("calibration"),
        work.bench.config.calibration.choices(),
        None if recipe.validation is None else work.given("run", recipe.validation),
    )
    work.figures |= do_at_the_desk(task, work.control, work.progress("images"), work.reporting.warn)
    Calibration.load(task.out)  # what is told as made can be read


def run_measure(recipe: Measure, work: Work) -> None:
    """Measure a run, with a report."""
    dic = work.bench.config.dic
    task = MeasureTask(
        work.given("calibration", recipe.calibration),
        work.given("run", recipe.run),
        work.making("result"),
        MeasureSettings(
            step_px=recipe.step_px or dic.step_px,
            subset_px=recipe.subset_px or dic.subset_px,
            stereo=recipe.stereo,
            extrapolate=recipe.extrapolate,
        ),
        work.making("report") if recipe.report else None,
        sphere_radius_mm=work.bench.config.sphere.radius_mm,
    )
    work.figures |= do_at_the_desk(task, work.control, work.progress("frames"), work.reporting.warn)
