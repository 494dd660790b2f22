"""Logs: readable on a terminal, JSON lines elsewhere (as under systemd); a job's lines name it, secrets never show."""

from __future__ import annotations

import logging
import os
import re
import sys
from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager
from typing import Any

import structlog

_SECRET_NAMES = re.compile(r"(?i)(^|_)(key|token|authorization|password|secret)s?$")
_SECRETS = re.compile(r"bscd_[0-9a-f]{8}_[A-Za-z0-9_-]{43}|(?<=[Bb]earer )\S+|(?<=token=)[^&\s]+")
_HIDDEN = "***"


def configure_logs(*, json: bool | None = None, level: str = "info") -> None:
    """Send all logs, those of libraries too, to standard error; ``json`` None: unless that is a terminal."""
    if json is None:
        json = not sys.stderr.isatty() or "JOURNAL_STREAM" in os.environ
    shared: list[Any] = [
        structlog.contextvars.merge_contextvars,
        structlog.stdlib.add_log_level,
        structlog.stdlib.add_logger_name,
        structlog.stdlib.PositionalArgumentsFormatter(),
        structlog.stdlib.ExtraAdder(),
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        structlog.processors.format_exc_info,
        hide_secrets,
    ]
    last = structlog.processors.JSONRenderer() if json else structlog.dev.ConsoleRenderer()
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=shared, processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, last]
        )
    )
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level.upper())
    structlog.configure(
        processors=[
            structlog.stdlib.filter_by_level,
            *(each for each in shared if not isinstance(each, structlog.stdlib.ExtraAdder)),
            structlog.stdlib.ProcessorFormatter.wrap_for_formatter,
        ],
        logger_factory=structlog.stdlib.LoggerFactory(),
        wrapper_class=structlog.stdlib.BoundLogger,
        cache_logger_on_first_use=False,
    )


@contextmanager
def bind_job(job_id: str) -> Iterator[None]:
    """Every line that is logged in here names the job."""
    with structlog.contextvars.bound_contextvars(job=job_id):
        yield


def hide_secrets(_: Any, __: str, line: MutableMapping[str, Any]) -> MutableMapping[str, Any]:
    """Take keys and tokens out of a line."""
    for name, value in line.items():
        if _SECRET_NAMES.search(name):
            line[name] = _HIDDEN
        elif isinstance(value, str):
            line[name] = _SECRETS.sub(_HIDDEN, value)
    return line
