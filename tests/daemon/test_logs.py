"""Logs as a program writes them: JSON or readable, with the job's id, without secrets."""

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
KEY = "bscd_0123abcd_" + "x" * 43

PROGRAM = f"""
import logging, sys, threading
import structlog
from bscd.daemon.logs import bind_job, configure_logs
configure_logs(json=sys.argv[1] == "json")
log = structlog.get_logger("ours")
with bind_job("job-1"):
    log.info("begins", recipe="home", key="{KEY}", authorization="Bearer secret")
    logging.getLogger("library").warning("asked for /events?token=abc&x=1 with %s", "Bearer {KEY}")
    threading.Thread(target=lambda: log.info("elsewhere")).start()
log.info("after")
try:
    1 / 0
except ZeroDivisionError:
    log.exception("a mistake")
"""


def written(how):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, how], capture_output=True, text=True, cwd=ROOT, env=os.environ, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
    return done.stderr


def test_json_lines_name_the_job_and_hide_secrets():
    text = written("json")
    lines = [json.loads(line) for line in text.splitlines()]
    by_event = {line["event"]: line for line in lines}
    assert by_event["begins"]["job"] == "job-1"
    assert by_event["begins"]["key"] == by_event["begins"]["authorization"] == "***"
    asked = next(line for line in lines if line["logger"] == "library")
    assert asked["job"] == "job-1"
    assert asked["event"] == "asked for /events?token=***&x=1 with Bearer ***"
    assert "job" not in by_event["after"]
    assert "ZeroDivisionError" in by_event["a mistake"]["exception"]
    assert {line["level"] for line in lines} == {"info", "warning", "error"}
    assert all(line["timestamp"].endswith("Z") for line in lines)
    assert KEY not in text
    assert "abc" not in text


def test_readable_lines_do_too():
    text = written("readable")
    assert "job-1" in text
    assert "begins" in text
    assert KEY not in text
    assert "secret" not in text
