"""Runs tests marked ``own_network`` in a network namespace of their own, so that no other process meets their ports.

All marked tests of a module run together in one child of pytest under ``unshare``, and their reports are shown as if
they had run here. Where the system allows no namespace they run in place, one process at a time.
"""

from __future__ import annotations

import fcntl
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import pytest

REPORTS = "BSCD_OWN_NETWORK_REPORTS"
"""In the child: the file that takes its reports."""
LONGEST_S = 900
"""What a module's tests may take together, beyond the longest time-out that one of them asks for."""

_reports: dict[str, list[pytest.TestReport]] = {}


def inside() -> bool:
    """Whether this process is the child."""
    return REPORTS in os.environ


@cache
def can_unshare() -> bool:
    """Whether the system allows a network namespace."""
    try:
        return subprocess.run(["unshare", "-rn", "true"], capture_output=True, timeout=10).returncode == 0
    except (OSError, subprocess.TimeoutExpired):
        return False


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    if item.get_closest_marker("own_network") is None or inside() or not can_unshare():
        return None
    if item.nodeid not in _reports:
        item.config.hook.pytest_timeout_cancel_timer(item=item)  # each test has its own time-out in the child
        _run_module_of(item)
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for report in _reports[item.nodeid]:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    # what the test before kept for this one, of its folder say, must go where the next one does not need it
    item.session._setupstate.teardown_exact(nextitem)
    return True


def _asked_s(item: pytest.Item) -> float:
    """The time-out of a test's own."""
    mark = item.get_closest_marker("timeout")
    return 0.0 if mark is None else float(mark.args[0])


def report_to_file(config: pytest.Config, report: pytest.TestReport) -> None:
    """In the child: hand a report to the parent."""
    data = config.hook.pytest_report_to_serializable(config=config, report=report)
    with open(os.environ[REPORTS], "a") as file:
        file.write(json.dumps(data) + "\n")


def _run_module_of(item: pytest.Item) -> None:
    items = [i for i in item.session.items if i.path == item.path and i.get_closest_marker("own_network")]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "reports")
        file.touch()
        command = ["unshare", "-rn", sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "no:xdist"]
        if item.config.getoption("--slow"):
            command.append("--slow")
        environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTEST_")}
        child = subprocess.run(
            [*command, *(i.nodeid for i in items)],
            cwd=item.config.rootpath,
            env={**environment, REPORTS: str(file)},
            capture_output=True,
            text=True,
            timeout=LONGEST_S + max(_asked_s(i) for i in items),
        )
        for line in file.read_text().splitlines():
            report = item.config.hook.pytest_report_from_serializable(config=item.config, data=json.loads(line))
            if isinstance(report.longrepr, list):  # where and why it was skipped: JSON knows no tuples
                report.longrepr = tuple(report.longrepr)
            _reports.setdefault(report.nodeid, []).append(report)
    for missed in items:
        if missed.nodeid not in _reports or _reports[missed.nodeid][-1].when != "teardown":
            said = f"the child ended with {child.returncode} before this test did\n{child.stdout}\n{child.stderr}"
            _reports.setdefault(missed.nodeid, []).append(
                pytest.TestReport(missed.nodeid, missed.location, {}, "failed", said, "teardown")
            )


@contextmanager
def one_at_a_time() -> Iterator[None]:
    """Holds the right to GVCP's port on this host's own loopback; waits for another process that has it."""
    if inside():
        yield
        return
    with open(Path(tempfile.gettempdir(), "bscd-gvcp.lock"), "w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
