"""One small daemon a module on the twin in virtual time, homed, with its API on a port of its own."""

from __future__ import annotations

import pytest

from tests.api.serving import api_of
from tests.daemon.small import done, small_daemon


@pytest.fixture(scope="module")
def daemon(tmp_path_factory):
    with small_daemon(tmp_path_factory.mktemp("client"), sensor_px=320, requests_per_s=10_000.0) as opened:
        done(opened, "home")
        yield opened


@pytest.fixture(scope="module")
def url(daemon):
    with api_of(daemon) as api:
        yield str(api.base_url)
