"""Jobs in words."""

from __future__ import annotations

from bscd.daemon.documents import JobDocument


def job_line(job: JobDocument) -> str:
    """A job in a line."""
    told = f"job {job.id}: {job.recipe.recipe}, {job.status.value}"
    if job.progress is not None and not job.status.ended:
        told += f", {progress_text(job)}"
    if job.prompt is not None:
        told += f"; asks: {job.prompt.text} (question {job.prompt.id})"
    return told + (f" ({job.reason})" if job.reason else "")


def progress_text(job: JobDocument) -> str:
    """How far a job is."""
    now = job.progress
    if now is None:
        return ""
    left = "" if now.left_s is None or now.done >= now.total else f", {_duration(now.left_s)} left"
    return f"{now.done}/{now.total} {now.unit}{left}: {now.doing}"


def ending_lines(job: JobDocument) -> list[str]:
    """What came of a job, a line each."""
    lines = [f"warning: {text}" for text in job.warnings]
    lines += [f"{what}: {name}" for what, name in job.outputs.items()]
    lines += [f"{name} = {_figure(value)}" for name, value in _flat(job.figures).items()]
    return lines


def _flat(figures: dict[str, object], before: str = "") -> dict[str, object]:
    flat: dict[str, object] = {}
    for name, value in figures.items():
        flat |= _flat(value, f"{before}{name}.") if isinstance(value, dict) else {f"{before}{name}": value}
    return flat


def _figure(value: object) -> str:
    if value is None:
        return "not known"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _duration(seconds: float) -> str:
    minutes = int(seconds // 60)
    return f"{minutes} min {seconds % 60:.0f} s" if minutes else f"{seconds:.0f} s"
