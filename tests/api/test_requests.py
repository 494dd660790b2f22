"""What is asked over HTTP, and what is refused: the right status, a problem that says what to do, nothing changed."""

from __future__ import annotations

import json

import numpy as np
import pytest

from bscd.acquisition import FrameRecord, RunWriter
from bscd.daemon.documents import JobStatus
from bscd.daemon.journal import JournalError
from tests.api.serving import api_of
from tests.daemon.small import ended, small_daemon, until
from tests.procedures.measuring.twin_runs import CAMERA

API = "/api/v1"


def problem(answer, status, code):
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    told = answer.json()
    assert (told["status"], told["code"]) == (status, code)
    assert told["title"]
    assert told["detail"]
    return told


def test_a_job_from_its_request_to_its_end(api, daemon):
    answer = api.post(f"{API}/jobs", json={"recipe": "move", "axis": "jacks", "position": 12.0})
    assert answer.status_code == 202
    job = answer.json()
    assert answer.headers["location"] == f"{API}/jobs/{job['id']}"
    until(lambda: api.get(answer.headers["location"]).json()["status"] == "done", "its end")
    over = api.get(answer.headers["location"]).json()
    assert over["figures"]["jacks_mm"] == pytest.approx(12.0, abs=0.2)
    assert over["operator"] == "local"
    assert api.get(f"{API}/jobs", params={"limit": 1}).json()[0]["id"] == job["id"]
    assert [one["id"] for one in api.get(f"{API}/jobs", params={"before": job["id"]}).json()][:1] != [job["id"]]


def test_the_same_idempotency_key_starts_it_once(api):
    home = {"recipe": "home"}
    answers = [api.post(f"{API}/jobs", json=home, headers={"Idempotency-Key": "once"}) for _ in range(3)]
    assert {answer.json()["id"] for answer in answers} == {answers[0].json()["id"]}
    told = problem(
        api.post(f"{API}/jobs", json={"recipe": "home", "again": True}, headers={"Idempotency-Key": "once"}),
        422,
        "input",
    )
    assert "was used for another recipe" in told["detail"]


def test_validation_says_what_it_would_take(api):
    looked = api.post(f"{API}/recipes:validate", json={"recipe": "reference-scan", "positions": 3}).json()
    assert looked["ok"] is True
    assert looked["limits"]["translation"]["least"] < looked["limits"]["translation"]["greatest"]
    assert looked["disk_bytes"] > 0
    assert set(api.get(f"{API}/recipes").json()) >= {"home", "bsc-scan", "campaign"}


@pytest.mark.parametrize(
    ("body", "status", "code", "told"),
    [
        ('{"recipe": "home"', 400, "malformed", "the body is no JSON"),
        ("", 422, "input", ""),
        ('{"recipe": "fly"}', 422, "input", "fly"),
        ('{"recipe": "move", "axis": "jacks"}', 422, "input", "position"),
        ('{"recipe": "home", "turbo": true}', 422, "input", "turbo"),
        ('{"recipe": "move", "axis": "jacks", "position": NaN}', 422, "input", "position"),
        ('{"recipe": "move", "axis": "jacks", "position": 1e9}', 422, "interlock", "its limits are 0 to 84 mm"),
        ('{"recipe": "measure", "calibration": "../../etc/passwd", "run": "x"}', 422, "input", "calibration"),
        ('{"recipe": "measure", "calibration": "none", "run": "none"}', 422, "interlock", "there is none of that name"),
        ("[" * 50_000, 400, "malformed", ""),
    ],
)
def test_a_job_that_can_not_be_changes_nothing(api, daemon, body, status, code, told):
    before, jobs = daemon.status().devices, len(daemon.jobs(limit=1000))
    answer = api.post(f"{API}/jobs", content=body, headers={"Content-Type": "application/json"})
    assert told in problem(answer, status, code)["detail"]
    assert len(daemon.jobs(limit=1000)) == jobs
    assert daemon.status().devices["jacks"].reading == before["jacks"].reading
    line = daemon.journal.audits(1)[0]
    assert (line.action, line.target, line.outcome) == ("POST", f"{API}/jobs", str(status))


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"poses": ["face", "face"]}, "poses names one twice"),
        ({"positions": 4}, "positions = 4 must be odd, so that POS.0 is the middle one"),
    ],
)
def test_a_scan_that_can_not_be_is_told_in_a_sentence(api, given, told):
    recipe = {"recipe": "reference-scan", **given}
    assert api.post(f"{API}/recipes:validate", json=recipe).json()["problems"] == [told]
    refused = problem(api.post(f"{API}/jobs", json=recipe), 422, "interlock")
    assert refused["problems"] == [told]
    assert refused["detail"] == f"reference-scan refused, nothing moved: {told}"


def test_a_journal_that_can_not_be_kept_is_not_the_askers_mistake(api, daemon, monkeypatch):
    def full(*_):
        raise JournalError("the journal can not be written (the disk is full); make room on the disk")

    monkeypatch.setattr(daemon, "submit", full)
    told = problem(api.post(f"{API}/jobs", json={"recipe": "home"}), 507, "journal")
    assert told["retryable"] is True
    assert "make room on the disk" in told["detail"]


def test_what_the_state_does_not_allow_is_409_with_what_it_does(api, daemon):
    told = problem(api.post(f"{API}/connect"), 409, "illegal-request")
    assert told["state"] == "idle"
    assert told["allowed"] == ["disconnect", "start", "estop"]
    job = ended(daemon, daemon.jobs(JobStatus.DONE, 1)[0])
    for what in ("pause", "resume", "stop", "abort"):
        told = problem(api.post(f"{API}/jobs/{job.id}/{what}"), 409, "illegal-request")
        assert told["state"] == "done"


def test_what_is_not_there_is_404(api):
    problem(api.get(f"{API}/jobs/20200101-000000-0000"), 404, "unknown-name")
    problem(api.get(f"{API}/runs/nothing"), 404, "unknown-name")
    problem(api.get(f"{API}/runs/nothing/file"), 404, "unknown-name")
    problem(api.get(f"{API}/nowhere"), 404, "not-found")
    problem(api.put(f"{API}/jobs"), 405, "method-not-allowed")
    problem(api.get("/docs"), 404, "not-found")


@pytest.mark.parametrize(
    "path",
    [
        "runs/..%2f..%2fjournal.sqlite",
        "runs/%2e%2e%2fkeys/file",
        "runs/..%5c..%5cx/file",
        "reports/x/..%2f..%2fjournal.sqlite",
        "reports/%2e%2e/journal.sqlite",
        "runs/a%00b/file",
    ],
)
def test_no_path_leads_out_of_the_data_folder(api, path):
    answer = api.get(f"{API}/{path}")
    assert answer.status_code in (404, 422)
    assert "SQLite" not in answer.text


def test_a_body_beyond_the_limit_is_refused_whatever_its_header_says(api, daemon):
    much = b" " * (daemon.settings.request_limit_bytes + 1)
    assert "may have" in problem(api.post(f"{API}/jobs", content=much), 413, "too-large")["detail"]

    def pieces():
        for _ in range(20):
            yield b" " * 100_000

    problem(api.post(f"{API}/jobs", content=pieces()), 413, "too-large")
    assert daemon.journal.audits(1)[0].outcome == "413"


def test_another_hosts_page_may_do_nothing(api, daemon):
    answer = api.post(f"{API}/estop", headers={"Origin": "http://evil.example"})
    assert "a page of http://evil.example may not do this" in problem(answer, 403, "forbidden")["detail"]
    assert not daemon.estop.latched
    answer = api.get(f"{API}/status", headers={"Origin": "http://evil.example"})
    assert "access-control-allow-origin" not in answer.headers
    assert api.get(f"{API}/status", headers={"Host": "evil.example"}).status_code == 400
    assert api.options(f"{API}/status", headers={"Origin": "http://evil.example"}).status_code in (400, 405)


def test_health_and_metrics(api):
    assert api.get("/health/live").json() == {"ok": True, "detail": ""}
    assert api.get("/health/ready").json() == {"ok": True, "detail": ""}
    text = api.get("/metrics").text
    assert 'bscd_state{state="idle"} 1.0' in text
    assert "bscd_pressure_kpa" in text
    assert 'bscd_requests_total{method="GET",route="/api/v1/status"' in text or "bscd_requests_total" in text


def test_the_e_stop_and_its_reset(api, daemon):
    answer = api.post(f"{API}/estop", json={"reason": "a test"}, headers={"X-Operator": "anna"})
    assert answer.status_code == 200
    assert answer.json()["by"] == "anna: a test"
    assert api.get(f"{API}/status").json()["state"] == "e-stopped"
    assert api.get("/health/ready").status_code == 503
    told = problem(api.post(f"{API}/jobs", json={"recipe": "home"}), 409, "illegal-request")
    assert told["allowed"] == ["estop", "reset"]
    assert api.post(f"{API}/estop/reset").json()["state"] == "idle"
    assert [line.action for line in daemon.journal.audits(4)].count("e-stop") == 1


def test_one_at_a_time_is_in_control(api, daemon):
    anna, bert = {"X-Operator": "anna"}, {"X-Operator": "bert"}
    daemon.lease.release("local")
    daemon.lease.release("anna")
    assert api.post(f"{API}/lease", headers=anna).json()["holder"] == "anna"
    told = problem(api.post(f"{API}/jobs", json={"recipe": "home"}, headers=bert), 423, "not-in-control")
    assert "anna is in control until" in told["detail"]
    assert daemon.journal.audits(1)[0].who == "bert"
    assert api.post(f"{API}/estop", headers=bert).status_code == 200  # it asks nobody
    assert api.post(f"{API}/estop/reset", headers=bert).status_code == 200
    assert api.post(f"{API}/lease", json={"force": True}, headers=bert).json()["holder"] == "bert"
    assert api.delete(f"{API}/lease", headers=bert).status_code == 204
    assert api.get(f"{API}/lease").json() is None
    told = problem(api.get(f"{API}/status", headers={"X-Operator": "<script>"}), 422, "input")
    assert "X-Operator" in told["detail"]


def test_a_run_is_downloaded_whole_and_in_parts(api, daemon):
    path = daemon.files.new("run", "to-download")
    with RunWriter(path, title="a run", cameras={"primary": CAMERA}) as run:
        run.append(FrameRecord("primary", "sphere", np.zeros((1024, 1280), np.uint8), 0))
    whole = path.read_bytes()
    (listed,) = [one for one in api.get(f"{API}/runs").json() if one["name"] == "to-download"]
    assert listed["bytes"] == len(whole)
    assert listed["about"]["frames"] == 1
    assert api.get(f"{API}/runs/to-download").json() == listed
    answer = api.get(f"{API}/runs/to-download/file")
    assert answer.content == whole
    assert "to-download.h5" in answer.headers["content-disposition"]
    part = api.get(f"{API}/runs/to-download/file", headers={"Range": "bytes=1000-"})
    assert part.status_code == 206
    assert part.content == whole[1000:]
    assert api.get(f"{API}/runs/to-download/file", headers={"Range": f"bytes={len(whole)}-"}).status_code == 416


def test_too_many_requests_are_slowed_but_never_the_e_stop(tmp_path):
    with small_daemon(tmp_path, sensor_px=320, requests_per_s=2.0) as daemon, api_of(daemon) as api:
        answers = [api.get(f"{API}/status") for _ in range(40)]
        told = problem(answers[-1], 429, "too-many-requests")
        assert told["retryable"] is True
        assert answers[-1].headers["retry-after"] == "1"
        assert answers[0].status_code == 200
        assert api.post(f"{API}/estop").status_code == 200
        assert api.get("/health/live").status_code == 200


@pytest.fixture
def keyed(tmp_path):
    """A daemon that has keys, and the keys by role."""
    with small_daemon(tmp_path, sensor_px=320) as daemon:
        keys = {role: daemon.keys.add(f"{role} person", role) for role in ("viewer", "operator", "admin")}
        with api_of(daemon) as api:
            yield daemon, api, keys


def bearer(key):
    return {"Authorization": f"Bearer {key}"}


def test_what_each_role_may(keyed):
    daemon, api, keys = keyed
    problem(api.get(f"{API}/status"), 401, "unauthorised")
    assert "bscd keys add" in problem(api.get("/metrics"), 401, "unauthorised")["detail"]
    for wrong in ("bscd_00000000_" + "x" * 43, "x", keys["admin"][:-1]):
        answer = api.get(f"{API}/status", headers=bearer(wrong))
        assert wrong not in problem(answer, 401, "unauthorised")["detail"]
        assert answer.headers["www-authenticate"] == "Bearer"
    assert api.get(f"{API}/status", headers=bearer(keys["viewer"])).status_code == 200
    told = problem(api.post(f"{API}/jobs", json={"recipe": "home"}, headers=bearer(keys["viewer"])), 403, "forbidden")
    assert told["detail"] == "viewer person is viewer; this needs operator; ask an admin for such a key"
    assert daemon.jobs() == []
    line = daemon.journal.audits(1)[0]
    assert (line.who, line.outcome) == ("viewer person", "403")
    job = api.post(f"{API}/jobs", json={"recipe": "home"}, headers=bearer(keys["operator"])).json()
    assert job["operator"] == "operator person"
    problem(api.get(f"{API}/audit", headers=bearer(keys["operator"])), 403, "forbidden")
    told = problem(api.post(f"{API}/lease", json={"force": True}, headers=bearer(keys["operator"])), 403, "forbidden")
    assert api.get(f"{API}/audit", headers=bearer(keys["admin"])).status_code == 200
    assert api.post(f"{API}/estop", headers=bearer(keys["viewer"])).status_code == 200
    problem(api.post(f"{API}/estop/reset", headers=bearer(keys["viewer"])), 403, "forbidden")
    assert daemon.estop.latched
    daemon.keys.revoke("operator person")
    problem(api.get(f"{API}/status", headers=bearer(keys["operator"])), 401, "unauthorised")
    told = json.dumps([line.model_dump(mode="json") for line in daemon.journal.audits(1000)])
    assert not any(key.split("_", 2)[2] in told for key in keys.values())
    assert api.get("/health/live").status_code == 200


def test_a_token_opens_one_stream_once(keyed):
    _, api, keys = keyed
    problem(api.post(f"{API}/tokens"), 401, "unauthorised")
    token = api.post(f"{API}/tokens", headers=bearer(keys["viewer"])).json()["token"]
    problem(api.get(f"{API}/status", params={"token": token}), 401, "unauthorised")  # no stream
    answer = api.get(f"{API}/camera/primary/snapshot.jpg", params={"token": token})
    assert answer.status_code in (200, 404)
    told = problem(api.get(f"{API}/camera/primary/snapshot.jpg", params={"token": token}), 401, "unauthorised")
    assert "was used already" in told["detail"]
