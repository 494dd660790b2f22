"""The API as it is documented: OpenAPI is committed, and whatever may be asked is answered as it says."""

from __future__ import annotations

import json
from pathlib import Path

import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from schemathesis.specs.openapi.checks import response_schema_conformance, status_code_conformance

from bscd.api.app import create_app
from tests.api.serving import api_of
from tests.daemon.small import small_daemon

COMMITTED = Path(__file__).resolve().parents[2] / "docs/openapi.json"


def test_the_committed_description_is_that_of_the_program(daemon):
    """After a change: python -m tests.api.write_openapi, and look at the difference: others have clients."""
    assert json.loads(COMMITTED.read_text(encoding="utf-8")) == create_app(daemon).openapi()


def test_every_problem_is_documented(daemon):
    described = create_app(daemon).openapi()
    for path, methods in described["paths"].items():
        for method, operation in methods.items():
            if path.startswith("/health"):
                continue
            assert {"401", "403", "422", "429"} <= set(operation["responses"]), (method, path)
            assert operation["responses"]["422"]["content"].keys() == {"application/problem+json"}


#: A rig that is e-stopped or at fault is not ready, and says so with this status; it breaks nothing.
JUSTIFIED = {("/health/ready", 503)}


def test_nothing_that_can_be_asked_breaks_it(tmp_path):
    """No 5xx of a rig that is well, no undocumented answer; streams are left out, they do not end."""
    with small_daemon(tmp_path, sensor_px=320, requests_per_s=1e6, queue_limit=1000) as daemon, api_of(daemon) as api:
        described = schemathesis.openapi.from_dict(create_app(daemon).openapi())
        described.config.update(base_url=str(api.base_url))
        asked = 0
        for result in described.get_all_operations():
            operation = result.ok()
            if operation.path.endswith(("/events", "/stream.mjpg")):
                continue

            @settings(
                max_examples=12,
                deadline=None,
                phases=[Phase.generate],
                suppress_health_check=list(HealthCheck),
                database=None,
                derandomize=True,
            )
            @given(case=operation.as_strategy())
            def ask(case):
                nonlocal asked
                asked += 1
                answer = case.call()
                assert answer.status_code < 500 or (case.path, answer.status_code) in JUSTIFIED, answer.text
                case.validate_response(answer, checks=[status_code_conformance, response_schema_conformance])

            ask()
        assert asked > 200
        assert daemon.live()[0]
