"""One small daemon a module on the twin in virtual time, homed, with its API on a port of its own."""

from __future__ import annotations

import pytest

from tests.api.serving import api_of
from tests.daemon.small import homed_daemon


@pytest.fixture(scope="module")
def daemon(tmp_path_factory):
    with homed_daemon(tmp_path_factory.mktemp("client")) as opened:
        yield opened


@pytest.fixture(scope="module")
def url(daemon):
    with api_of(daemon) as api:
        yield str(api.base_url)
