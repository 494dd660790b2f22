"""The commands that talk to a daemon, on a small twin: what they print, and their exit codes."""

from __future__ import annotations

import re

import pytest

from bscd.cli.app import run as bscd
from bscd.daemon.documents import JobStatus
from tests.api.serving import api_of
from tests.daemon.small import small_daemon, until


@pytest.fixture(scope="module")
def daemon(tmp_path_factory):
    with small_daemon(tmp_path_factory.mktemp("remote"), sensor_px=320, requests_per_s=10_000.0) as opened:
        yield opened


@pytest.fixture(scope="module")
def served(daemon):
    with api_of(daemon) as api:
        yield str(api.base_url)


@pytest.fixture
def command(served, monkeypatch, capsys):
    monkeypatch.setenv("BSCD_URL", served)
    monkeypatch.setenv("USER", "anna")

    def run(*arguments):
        code = bscd([str(argument) for argument in arguments])
        told = capsys.readouterr()
        return code, told.out, told.err

    return run


CAMPAIGN = """
recipe = "campaign"
title = "a short one"

[[steps]]
name = "home"
do = { recipe = "home" }

[[steps]]
name = "up"
do = { recipe = "move", axis = "jacks", position = 40.0 }
"""


def test_a_campaign_from_its_file_to_its_end(command, tmp_path, daemon):
    path = tmp_path / "short.toml"
    path.write_text(CAMPAIGN)
    code, out, err = command("run", path, "--follow")
    assert code == 0, err
    assert re.search(r"job \S+: campaign, queued", out)
    assert "up.jacks_mm = 40" in out
    assert "step 2 of 2, up" in err
    code, out, _ = command("status")
    assert code == 0
    assert "digital twin: idle" in out
    assert re.search(r"jacks +40\.0", out)
    code, out, _ = command("jobs", "--status", "done")
    assert "campaign, done" in out
    assert daemon.jobs(JobStatus.DONE, 1)[0].operator == "anna"


def test_a_recipe_by_its_name_with_settings(command):
    code, out, _ = command("run", "move", "--set", "axis=jacks", "--set", "position=12.5", "--follow")
    assert code == 0
    assert "jacks_mm = 12.5" in out
    code, out, _ = command("run", "bsc-scan", "--set", "positions=3", "--check")
    assert code == 0
    assert "frames" in out
    assert re.search(r"translation: \S+ to \S+ \(limits 0 to 100\)", out)
    code, _, err = command("run", "inflation", "--set", "inflation.top_kpa=99", "--check")
    assert code == 1
    assert "top_kpa = 99 kPa is outside" in err


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["run", "fly"], "recipe = 'fly' is not known; known are home, move"),
        (["run", "nothing.toml"], "nothing.toml: can not be read"),
        (["run", "move", "--set", "axis"], "--set axis: is no KEY=VALUE"),
        (["run", "move", "--set", "axis=jacks"], "position: Field required"),
        (["run", "move", "--set", "axis=jacks", "--set", "position=900"], "its limits are 0 to 84 mm"),
        (["run", "bsc-scan", "--set", 'poses=["face","face"]'], "nothing moved: poses names one twice"),
        (["pause"], "no job is on the bench; name one of bscd jobs"),
        (["jobs", "nothing"], "there is none of that name"),
        (["download", "nothing", "-o", "/tmp/never.h5"], "there is none of that name"),
        (["status", "--url", "http://127.0.0.1:9"], "no daemon answers"),
    ],
)
def test_what_can_not_be_is_told_in_a_line(command, arguments, told):
    code, _, err = command(*arguments)
    assert code == 1
    assert told in err
    assert len(err.strip().splitlines()) == 1


def test_e_stop_and_reset(command, daemon):
    code, out, _ = command("estop", "--reason", "a test")
    assert code == 0
    assert re.search(r"every stop command was given within [0-9.]+ ms; latched", out)
    assert daemon.estop.document().by == "anna: a test"
    assert "e-stop latched by anna: a test" in command("status")[1]
    code, out, _ = command("estop", "--reset")
    assert code == 0
    assert "reset; the rig is idle" in out


@pytest.mark.parametrize(
    ("user", "by"),
    [
        ("DOM\\alice", "DOM-alice"),
        ("zo\u00eb", "zoe"),
        ("<b>", "b-"),
        ("\u041c\u0430\u0440\u0438\u044f", "local"),
        ("\udcff", "local"),
        ("", "local"),
        ("a" * 300, "a" * 80),
    ],
)
def test_any_name_of_a_user_will_do(command, daemon, monkeypatch, user, by):
    monkeypatch.setenv("USER", user)
    code, _, err = command("status")
    assert (code, err) == (0, "")
    code, _, err = command("estop", "--reason", "smoke \udcff")
    assert (code, err) == (0, "")
    assert daemon.estop.document().by == f"{by}: smoke ?"
    assert command("estop", "--reset")[0] == 0


def test_the_e_stop_needs_no_key_that_can_be_read(command, daemon, tmp_path, monkeypatch):
    path = tmp_path / "key"
    monkeypatch.setenv("BSCD_KEY_FILE", str(path))
    for content in (None, b"bscd_x", b"\xff\xfe"):
        if content is not None:
            path.write_bytes(content)
            path.chmod(0o644 if content == b"bscd_x" else 0o600)
        assert command("status")[0] == 1
        code, _, err = command("estop")
        assert code == 0
        assert err.startswith(f"warning: {path}: ")
        assert command("estop", "--reset")[0] == 1  # that can wait for the right key
        daemon.reset_estop("test")
    monkeypatch.setenv("BSCD_KEY", "no key\u00e9")
    assert command("estop")[0] == 0
    code, _, err = command("status")
    assert (code, "the key is not known" in err) == (1, True)
    daemon.reset_estop("test")


def test_pause_resume_stop_and_confirm(command, tmp_path, monkeypatch):
    with (
        small_daemon(tmp_path, sensor_px=320, virtual=False, attended=True) as daemon,
        api_of(daemon) as api,
    ):
        monkeypatch.setenv("BSCD_URL", str(api.base_url))
        assert command("run", "home", "--set", 'prompt="hands off?"')[0] == 0
        until(lambda: (job := daemon.engine.current) and job.prompt, "the question")
        job = daemon.engine.current
        assert f"asks: hands off? (question {job.prompt.id})" in command("jobs")[1]
        assert command("pause")[0] == 0
        until(lambda: daemon.job(job.id).status is JobStatus.PAUSED, "the pause")
        assert command("resume")[0] == 0
        code, _, err = command("confirm", job.id, 99)
        assert (code, "question 99: is not open" in err) == (1, True)
        assert command("stop")[0] == 0
        until(lambda: daemon.job(job.id).status.ended, "its end")
        assert "stopped" in command("jobs", job.id)[1]
        assert command("resume", job.id)[0] == 0
        until(lambda: (now := daemon.engine.current) and now.prompt, "the question again")
        assert command("confirm", job.id, daemon.engine.current.prompt.id)[0] == 0
        until(lambda: daemon.job(job.id).status is JobStatus.DONE, "its end")


def test_runs_are_listed_and_fetched(command, daemon, tmp_path):
    inflation = ["--set", 'inflation={"rest_frames": 2, "ramp_s": 0.2, "hold_s": 0.2, "top_kpa": 1}', "--set"]
    assert command("run", "inflation", *inflation, "compression=bitshuffle-lz4", "--follow")[0] == 0
    code, out, _ = command("runs")
    assert code == 0
    name = out.split()[0]
    assert "frames 6" in out
    code, out, _ = command("download", name, "-o", tmp_path / "run.h5")
    assert code == 0
    assert (tmp_path / "run.h5").read_bytes() == daemon.files.path("run", name).read_bytes()


def test_keys_are_made_listed_and_revoked(command, tmp_path):
    code, key, err = command("keys", "add", "anna", "--role", "operator", "--data", tmp_path)
    assert code == 0
    assert re.fullmatch(r"bscd_[0-9a-f]{8}_[A-Za-z0-9_-]{43}\n", key)
    assert "it is not shown again" in err
    listed = command("keys", "list", "--data", tmp_path)[1]
    assert re.search(r"anna +operator +since", listed)
    assert key.strip() not in listed
    assert command("keys", "add", "anna", "--data", tmp_path)[0] == 1
    assert command("keys", "revoke", "anna", "--data", tmp_path)[0] == 0
    assert "none in" in command("keys", "list", "--data", tmp_path)[1]


def test_a_key_file_that_others_may_read_is_not_used(command, tmp_path, monkeypatch):
    path = tmp_path / "key"
    path.write_text("bscd_x")
    path.chmod(0o644)
    monkeypatch.setenv("BSCD_KEY_FILE", str(path))
    code, _, err = command("status")
    assert code == 1
    assert f"others may read this key; chmod 600 {path}" in err
