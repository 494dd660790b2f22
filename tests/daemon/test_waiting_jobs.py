"""Jobs that wait: for the operator, for their turn, for a rig that can take them; and requests that were not kept."""

import re

import pytest
from sqlalchemy.exc import OperationalError

from bscd.daemon.documents import JobStatus, RigState
from bscd.daemon.errors import IllegalRequestError, InterlockError
from bscd.daemon.journal import JournalError
from tests.daemon.small import config_text, done, ended, recipe, small_daemon, until

#: The jacks of the twin, as its configuration has them.
JACKS = re.search(r"\[devices\.jacks\]\n(?:[^\[\n].*\n)*", config_text(320)).group(0)


@pytest.mark.parametrize("kind", [{"prompt": "is it the right run?"}, {"specimen": "sphere"}])
def test_nobody_is_asked_at_the_desk(tmp_path, kind):
    with small_daemon(tmp_path, sensor_px=320, attended=True) as daemon:
        for name in ("a", "b"):
            daemon.files.new("run", name).write_text("no run")
        with pytest.raises(InterlockError, match="calibrate: is done at the desk, where nobody is asked"):
            daemon.submit(recipe("calibrate", reference="a", bsc="b", **kind), "test")
        assert daemon.jobs() == []


def test_a_job_that_waits_for_the_operator_still_does_after_a_pause(tmp_path):
    with small_daemon(tmp_path, sensor_px=320, virtual=False, attended=True) as daemon:
        job = daemon.submit(recipe("home", prompt="hands off?"), "test")
        until(lambda: daemon.job(job.id).status is JobStatus.WAITING, "the question")
        daemon.pause_job(job.id, "test")
        until(lambda: daemon.job(job.id).status is JobStatus.PAUSED, "the pause")
        assert daemon.resume_job(job.id, "test").status is JobStatus.WAITING
        assert daemon.states.state is RigState.RUNNING
        daemon.confirm(job.id, daemon.job(job.id).prompt.id, "test")
        assert ended(daemon, job).status is JobStatus.DONE


def test_a_stop_does_not_wait_for_whoever_turns_a_jack(tmp_path):
    by_hand = {JACKS: '[devices.jacks]\ndriver = "axis.manual"\n'}
    with small_daemon(tmp_path, sensor_px=320, virtual=False, attended=True, changes=by_hand) as daemon:
        job = daemon.submit(recipe("home"), "test")
        until(lambda: daemon.job(job.id).prompt is not None, "the question")
        daemon.confirm(job.id, daemon.job(job.id).prompt.id, "test", 30.0)
        assert ended(daemon, job).figures["jacks_mm"] == 30.0
        move = daemon.submit(recipe("move", axis="jacks", position=50.0), "test")
        until(lambda: daemon.job(move.id).prompt is not None, "the question")
        assert daemon.job(move.id).status is JobStatus.WAITING
        turning = daemon.job(move.id).prompt
        daemon.stop_job(move.id, "test")
        asked = until(lambda: (p := daemon.job(move.id).prompt) is not None and p.id != turning.id and p, "the stop")
        assert "STOP, turn no further" in asked.text
        daemon.confirm(move.id, asked.id, "test", 42.0)
        over = ended(daemon, move)
        assert (over.status, over.prompt) == (JobStatus.STOPPED, None)
        assert daemon.bench.rig.jacks.status().position == 42.0
        until(lambda: daemon.states.state is RigState.IDLE, "a rig at rest")


def test_a_job_that_is_stopped_as_the_rig_stops_is_not_left_behind(tmp_path):
    with small_daemon(tmp_path, sensor_px=320) as daemon:
        run = daemon.engine.shop._run

        def overtaken(job, control):
            daemon.engine.shop._run = run
            daemon.stop_job(job.id, "test")
            daemon.estop.trigger("test")
            run(job, control)

        daemon.engine.shop._run = overtaken
        job = ended(daemon, daemon.submit(recipe("home"), "test"))
        assert job.status in (JobStatus.STOPPED, JobStatus.ABORTED)
        assert job.reason
        daemon.reset_estop("test")
        done(daemon, "home")


def test_what_is_resumed_waits_in_the_same_line(tmp_path):
    with small_daemon(tmp_path, sensor_px=320, virtual=False, attended=True, queue_limit=1) as daemon:
        first = daemon.submit(recipe("home", prompt="clear?"), "test")
        until(lambda: daemon.job(first.id).status is JobStatus.WAITING, "the question")
        ids = []
        for _ in range(2):
            ids.append(daemon.submit(recipe("home"), "test").id)
            daemon.stop_job(ids[-1], "test")
        daemon.resume_from(ids[0], "test")
        with pytest.raises(IllegalRequestError, match="1 jobs wait already"):
            daemon.resume_from(ids[1], "test")
        assert daemon.status().queue == (ids[0],)
        daemon.stop_job(ids[0], "test")
        daemon.stop_job(first.id, "test")


def test_a_request_that_could_not_be_kept_starts_nothing(tmp_path):
    with small_daemon(tmp_path, sensor_px=320) as daemon:
        known = len(daemon.jobs())
        remember = daemon.journal._remember

        def full(*_):
            raise OperationalError("INSERT", {}, Exception("database or disk is full"))

        daemon.journal._remember = full
        with pytest.raises(JournalError, match="can not be written"):
            daemon.submit(recipe("home"), "test", "key-2")
        daemon.journal._remember = remember
        assert len(daemon.jobs()) == known
        assert daemon.status().queue == ()
        job = daemon.submit(recipe("home"), "test", "key-2")
        assert ended(daemon, job).status is JobStatus.DONE
        assert len(daemon.jobs()) == known + 1
