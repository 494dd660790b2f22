"""The journal: what is acknowledged outlasts a kill; damage loses nothing that was there."""

import signal
import sqlite3
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import pytest
from sqlalchemy import text

from bscd.daemon.documents import JobDocument, JobStatus, PromptDocument
from bscd.daemon.errors import UnknownNameError
from bscd.daemon.journal import KEY_LIFE_S, Journal, JournalError, RequestKey
from bscd.daemon.journal_file import VERSION, opened
from bscd.daemon.recipes import Home
from bscd.errors import InputError

ROOT = Path(__file__).resolve().parents[2]
T0 = datetime(2026, 1, 1, tzinfo=UTC)


def job(number, status=JobStatus.QUEUED, **changes):
    about = {"created_at": T0 + timedelta(seconds=number), "operator": "test", "place": "bench", **changes}
    return JobDocument(id=f"job-{number}", recipe=Home(), status=status, **about)


def asked(path, query):
    """What another program reads from the file."""
    with closing(sqlite3.connect(path)) as connection:
        return connection.execute(query).fetchall()


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


def test_the_age_is_when_a_job_was_made_and_then_the_order_of_saving(journal):
    half_past = T0 + timedelta(seconds=10.5)
    times = {
        0: T0 + timedelta(seconds=20),  # saved first, made last: the clock was set back
        1: T0 + timedelta(seconds=10),
        2: half_past.astimezone(timezone(timedelta(hours=-9))),
        3: half_past,
        4: half_past.astimezone(timezone(timedelta(hours=5))),
        5: T0,
    }
    for number, created_at in times.items():
        journal.save(job(number, created_at=created_at))
    journal.save(job(2, JobStatus.RUNNING, created_at=times[2]))  # a change makes none newer
    expected = [f"job-{n}" for n in (0, 4, 3, 2, 1, 5)]
    assert [one.id for one in journal.jobs()] == expected
    paged, last = [], None
    while page := journal.jobs(limit=1, before=last):
        last = page[0].id
        paged.append(last)
    assert paged == expected
    with pytest.raises(UnknownNameError, match="job 'job-9': there is none of that name to list on from"):
        journal.jobs(before="job-9")


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


def test_the_audit_tells_who_asked_for_what_and_when(tmp_path):
    now = [T0.timestamp()]
    with closing(Journal(tmp_path / "journal.sqlite", now_s=lambda: now[0])) as journal:
        journal.audit("anna", "POST", "/api/v1/jobs", "202")
        now[0] += 1.5
        journal.audit("bert", "POST", "/api/v1/jobs", "423", "anna is in control")
        assert [(one.who, one.time, one.outcome, one.detail) for one in journal.audits()] == [
            ("bert", T0 + timedelta(seconds=1.5), "423", "anna is in control"),
            ("anna", T0, "202", ""),
        ]
        assert [one.who for one in journal.audits(1)] == ["bert"]


def test_an_idempotency_key_is_known_for_a_day(tmp_path):
    now, path = [1000.0], tmp_path / "journal.sqlite"
    with closing(Journal(path, now_s=lambda: now[0])) as journal:
        journal.save(job(1), RequestKey("k", "print"))
        assert journal.recall("other") is None
        now[0] += KEY_LIFE_S - 1.0
        assert journal.recall("k") == ("print", "job-1")
    now[0] += 2.0
    with closing(Journal(path, now_s=lambda: now[0])) as journal:
        assert journal.recall("k") is None
        assert asked(path, "SELECT key FROM idempotency") == [("k",)]
        journal.save(job(2), RequestKey("new", "print"))
        assert asked(path, "SELECT key FROM idempotency") == [("new",)]  # the old one takes no room any more
        journal.save(job(3), RequestKey("k", "other print"))
        assert journal.recall("k") == ("other print", "job-3")


def test_many_threads_lose_nothing(journal):
    def work(first):
        for number in range(first, first + 10):
            journal.save(job(number), RequestKey(f"key-{number}", "print"))
            journal.audit(f"thread {first}", "POST", f"job-{number}", "202")
            journal.save(job(number, JobStatus.DONE))
            assert journal.job(f"job-{number}").status is JobStatus.DONE
            assert journal.recall(f"key-{number}") == ("print", f"job-{number}")
            assert len(journal.jobs(limit=5)) <= 5

    with ThreadPoolExecutor(16) as threads:
        for done in [threads.submit(work, 100 * n) for n in range(16)]:
            done.result(timeout=120.0)
    numbers = {100 * n + k for n in range(16) for k in range(10)}
    found = journal.jobs(limit=1000)
    assert {one.id for one in found} == {f"job-{n}" for n in numbers}
    assert {one.status for one in found} == {JobStatus.DONE}
    lines = journal.audits(1000)
    assert {one.target for one in lines} == {f"job-{n}" for n in numbers}
    assert [one.id for one in lines] == sorted((one.id for one in lines), reverse=True)
    assert len(lines) == len(numbers)


SAVER = """
import resource, sys, threading
from pathlib import Path
from bscd.daemon.documents import JobStatus
from bscd.daemon.journal import Journal, JournalError
from tests.daemon.test_journal import job
journal = Journal(Path(sys.argv[1]))
if len(sys.argv) > 2:
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), int(sys.argv[2])))
def save(first):
    for number in range(first, first + 100_000):
        journal.save(job(number))
        journal.save(job(number, JobStatus.DONE))
        print(f"{number}\\n", end="", flush=True)
if len(sys.argv) > 2:
    try:
        save(0)
    except JournalError as error:
        print(error, file=sys.stderr)
        journal.close()
else:
    for first in (100_000, 200_000, 300_000):
        threading.Thread(target=save, args=(first,)).start()
"""


def test_what_was_acknowledged_outlasts_a_kill(tmp_path):
    path = tmp_path / "journal.sqlite"
    command = [sys.executable, "-c", SAVER, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as saver:
        assert saver.stdout is not None
        told = [saver.stdout.readline() for _ in range(60)]
        saver.kill()
        told += saver.stdout.read().splitlines(keepends=True)
    assert saver.returncode == -signal.SIGKILL
    acknowledged = {f"job-{int(line)}" for line in told if line.endswith("\n")}
    assert len(acknowledged) >= 60
    with closing(Journal(path)) as journal:
        assert journal.problem == ""
        kept = {one.id: one.status for one in journal.jobs(limit=100_000)}
        assert {kept.get(name) for name in acknowledged} == {JobStatus.DONE}
        journal.save(job(1))
    assert asked(path, "PRAGMA integrity_check") == [("ok",)]


def test_a_write_that_fails_is_told_and_loses_nothing_before_it(tmp_path):
    path = tmp_path / "journal.sqlite"
    command = [sys.executable, "-c", SAVER, str(path), "200000"]
    saver = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=120.0)
    assert saver.returncode == 0, saver.stderr
    (sentence,) = saver.stderr.splitlines()
    assert sentence.startswith(f"{path}: the journal can not be written (")
    assert "disk" in sentence
    assert "job-" not in sentence  # no statement, no values, no class of an error
    assert "sqlite3" not in sentence
    with closing(Journal(path)) as journal:
        assert journal.problem == ""
        kept = {one.id for one in journal.jobs(limit=100_000) if one.status is JobStatus.DONE}
        assert kept >= {f"job-{number}" for number in saver.stdout.split()}
        assert kept


def test_each_commit_reaches_the_disk(tmp_path):
    path = tmp_path / "journal.sqlite"
    engine, problem = opened(path, T0)
    with engine.connect() as connection:
        assert connection.execute(text("PRAGMA synchronous")).scalar() == 2  # FULL
    engine.dispose()
    assert problem == ""
    assert asked(path, "PRAGMA journal_mode") == [("wal",)]
    assert asked(path, "PRAGMA user_version") == [(VERSION,)]


def test_a_closed_journal_refuses(tmp_path):
    journal = Journal(tmp_path / "journal.sqlite")
    journal.save(job(1))
    journal.close()
    journal.close()
    with pytest.raises(JournalError, match="can not be written, it is closed"):
        journal.save(job(2))
    with pytest.raises(JournalError, match="can not be read, it is closed"):
        journal.job("job-1")
    assert sorted(one.name for one in tmp_path.iterdir()) == ["journal.sqlite"]


DAMAGE = {"no database": b"this is no database" * 100, "zeros": b"\0" * 5000, "cut off": b"SQLite format 3\0"}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE.keys())
def test_a_damaged_file_is_kept_aside(tmp_path, damage):
    path = tmp_path / "journal.sqlite"
    path.write_bytes(damage)
    with closing(Journal(path, now_s=T0.timestamp)) as journal:
        assert journal.problem.startswith(f"{path}: the journal was damaged (")
        assert "is kept as journal-damaged-20260101T000000Z.sqlite; a new one was begun" in journal.problem
        journal.save(job(1))
    assert (tmp_path / "journal-damaged-20260101T000000Z.sqlite").read_bytes() == damage
    with closing(Journal(path)) as journal:
        assert journal.problem == ""
        assert journal.job("job-1") == job(1)


def test_no_damaged_file_takes_the_place_of_another(tmp_path):
    path = tmp_path / "journal.sqlite"
    for number in range(3):
        path.write_bytes(b"damaged %d" % number * 1000)
        path.with_name("journal.sqlite-wal").write_bytes(b"beside %d" % number * 1000)
        Journal(path, now_s=T0.timestamp).close()
    for number, ending in enumerate(("", "-2", "-3")):
        aside = tmp_path / f"journal-damaged-20260101T000000Z{ending}.sqlite"
        assert aside.read_bytes() == b"damaged %d" % number * 1000
        assert aside.with_name(aside.name + "-wal").read_bytes() == b"beside %d" % number * 1000


def test_damage_deep_inside_is_found(tmp_path):
    path = tmp_path / "journal.sqlite"
    with closing(Journal(path)) as journal:
        for number in range(100):
            journal.save(job(number))
    content = bytearray(path.read_bytes())
    middle = len(content) // 2 // 4096 * 4096
    content[middle : middle + 8192] = b"\xa5" * 8192
    path.write_bytes(content)
    with closing(Journal(path)) as journal:
        assert "the journal was damaged (" in journal.problem
        assert journal.jobs() == []
    (kept,) = tmp_path.glob("journal-damaged-*.sqlite")
    assert kept.read_bytes() == content


def test_damage_while_in_use_is_told(tmp_path):
    path = tmp_path / "journal.sqlite"
    with closing(Journal(path)) as journal:
        for number in range(100):
            journal.save(job(number))
    with closing(Journal(path)) as journal:
        with path.open("r+b") as file:
            file.seek(4096)
            file.write(b"\xa5" * (path.stat().st_size - 4096))
        with pytest.raises(JournalError, match=r"can not be read .*keeps the damaged file aside"):
            journal.jobs()


def test_a_newer_journal_is_refused_and_left_alone(tmp_path):
    path = tmp_path / "journal.sqlite"
    Journal(path).close()
    asked(path, "PRAGMA user_version = 99")
    before = path.read_bytes()
    with pytest.raises(InputError, match="is the journal of a newer bscd"):
        Journal(path)
    assert path.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir() if "damaged" in one.name] == []


def test_a_path_that_can_not_be_used_is_told(tmp_path):
    (tmp_path / "folder.sqlite").mkdir()
    for path in (tmp_path / "folder.sqlite", tmp_path / "none" / "journal.sqlite"):
        with pytest.raises(InputError) as refused:
            Journal(path)
        assert str(refused.value).startswith(f"{path}: the journal can not be used (")
        assert "\n" not in str(refused.value)


def test_a_job_of_another_version_is_told_in_a_sentence(tmp_path):
    path = tmp_path / "journal.sqlite"
    with closing(Journal(path)) as journal:
        journal.save(job(1))
        with closing(sqlite3.connect(path)) as connection, connection:
            connection.execute("UPDATE jobs SET document = replace(document, '\"home\"', '\"dance\"')")
        with pytest.raises(InputError, match=r"does not know \(recipe: .*install the version that made it") as refused:
            journal.jobs()
        assert "\n" not in str(refused.value)
