"""The journal: what is acknowledged outlasts a kill; damage loses nothing that was there."""

import os
import signal
import sqlite3
import subprocess
import sys
import threading
from datetime import UTC, datetime, timedelta

import pytest

from bscd.daemon.documents import JobDocument, JobStatus, PromptDocument
from bscd.daemon.errors import UnknownNameError
from bscd.daemon.journal import KEY_LIFE_S, Journal
from bscd.daemon.recipes import Home
from bscd.errors import InputError

T0 = datetime(2026, 1, 1, tzinfo=UTC)


def job(number, status=JobStatus.QUEUED, **changes):
    return JobDocument(
        id=f"job-{number}",
        recipe=Home(),
        place="bench",
        status=status,
        operator="test",
        created_at=T0 + timedelta(seconds=number),
        **changes,
    )


@pytest.fixture
def journal(tmp_path):
    opened = Journal(tmp_path / "journal.sqlite")
    yield opened
    opened.close()


def test_a_job_is_read_as_it_was_saved(journal):
    saved = job(1, JobStatus.DONE, outputs={"run": "a"}, figures={"x_mm": 1.5, "y": None}, warnings=("w",))
    journal.save(job(1))
    journal.save(saved)
    assert journal.job("job-1") == saved
    with pytest.raises(UnknownNameError, match="there is none of that name"):
        journal.job("job-2")


def test_lists_are_newest_first_and_can_be_paged(journal):
    for number in range(5):
        journal.save(job(number, JobStatus.DONE if number % 2 else JobStatus.QUEUED))
    assert [one.id for one in journal.jobs()] == [f"job-{n}" for n in (4, 3, 2, 1, 0)]
    assert [one.id for one in journal.jobs(limit=2)] == ["job-4", "job-3"]
    assert [one.id for one in journal.jobs(limit=2, before="job-3")] == ["job-2", "job-1"]
    assert [one.id for one in journal.jobs(JobStatus.DONE)] == ["job-3", "job-1"]
    assert [one.id for one in journal.queue()] == ["job-0", "job-2", "job-4"]


def test_reconcile_ends_what_ran_and_leaves_the_line(journal):
    prompt = PromptDocument(id=1, text="sphere?")
    ran = [JobStatus.RUNNING, JobStatus.WAITING, JobStatus.PAUSING, JobStatus.PAUSED, JobStatus.STOPPING]
    for number, status in enumerate([*ran, JobStatus.QUEUED, JobStatus.DONE, JobStatus.FAILED]):
        journal.save(job(number, status, next_step=3, prompt=prompt if status is JobStatus.WAITING else None))
    interrupted = journal.reconcile("the daemon ended under it")
    assert [one.id for one in interrupted] == [f"job-{n}" for n in range(5)]
    for one in interrupted:
        kept = journal.job(one.id)
        assert kept == one
        assert (kept.status, kept.next_step, kept.prompt) == (JobStatus.INTERRUPTED, 3, None)
        assert kept.reason == "the daemon ended under it"
    assert journal.job("job-5").status is JobStatus.QUEUED
    assert journal.job("job-6").status is JobStatus.DONE
    assert journal.reconcile("again") == []


def test_audit_and_keys(tmp_path):
    now = [1000.0]
    journal = Journal(tmp_path / "journal.sqlite", now_s=lambda: now[0])
    journal.audit("anna", "POST", "/api/v1/jobs", "202")
    journal.audit("bert", "POST", "/api/v1/jobs", "423", "anna is in control")
    assert [(one.who, one.outcome, one.detail) for one in journal.audits()] == [
        ("bert", "423", "anna is in control"),
        ("anna", "202", ""),
    ]
    journal.remember("k", "print", "job-1")
    assert journal.recall("k") == ("print", "job-1")
    assert journal.recall("other") is None
    now[0] += KEY_LIFE_S + 1.0
    assert journal.recall("k") is None
    journal.close()


def test_many_threads_lose_nothing(journal):
    def save(first):
        for number in range(first, first + 20):
            journal.save(job(number))
            journal.save(job(number, JobStatus.DONE))

    threads = [threading.Thread(target=save, args=(100 * n,)) for n in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    found = journal.jobs(limit=1000)
    assert len(found) == 120
    assert {one.status for one in found} == {JobStatus.DONE}


SAVER = """
import sys
from pathlib import Path
from bscd.daemon.journal import Journal
from tests.daemon.test_journal import job
journal = Journal(Path(sys.argv[1]))
for number in range(100000):
    journal.save(job(number))
    print(number, flush=True)
"""


def test_what_was_acknowledged_outlasts_a_kill(tmp_path):
    path = tmp_path / "journal.sqlite"
    with subprocess.Popen([sys.executable, "-c", SAVER, str(path)], stdout=subprocess.PIPE, text=True) as saver:
        assert saver.stdout is not None
        last = [saver.stdout.readline() for _ in range(40)][-1]
        os.kill(saver.pid, signal.SIGKILL)
        last = ([last, *saver.stdout.read().split()])[-1]
    journal = Journal(path)
    assert journal.problem == ""
    assert {one.id for one in journal.jobs(limit=100_000)} >= {f"job-{n}" for n in range(int(last) + 1)}
    journal.close()


@pytest.mark.parametrize("damage", [b"this is no database" * 100, b"\0" * 5000])
def test_a_damaged_file_is_kept_aside(tmp_path, damage):
    path = tmp_path / "journal.sqlite"
    path.write_bytes(damage)
    journal = Journal(path)
    journal.save(job(1))
    assert "was damaged and is kept as journal-damaged-" in journal.problem
    (kept,) = tmp_path.glob("journal-damaged-*.sqlite")
    assert kept.read_bytes() == damage
    journal.close()


def test_a_newer_journal_is_refused_and_left_alone(tmp_path):
    path = tmp_path / "journal.sqlite"
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA user_version = 99")
    connection.close()
    before = path.read_bytes()
    with pytest.raises(InputError, match="is the journal of a newer bscd"):
        Journal(path)
    assert path.read_bytes() == before
