"""One small daemon on the twin in virtual time, homed, with its API on a port of its own."""

from __future__ import annotations

import pytest

from tests.api.serving import api_of
from tests.daemon.small import homed_daemon


@pytest.fixture(scope="package")
def daemon(tmp_path_factory):
    with homed_daemon(tmp_path_factory.mktemp("api")) as opened:
        yield opened


@pytest.fixture(scope="package")
def api(daemon):
    with api_of(daemon) as client:
        yield client
