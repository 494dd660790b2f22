"""By which names and addresses the daemon can be reached."""

from __future__ import annotations

import socket

import pytest

from bscd.api.server import listening
from bscd.client import Client
from tests.api.serving import api_of, configuration, serving
from tests.api.test_requests import problem
from tests.daemon.small import small_daemon

STATUS = "/api/v1/status"


def has_ipv6() -> bool:
    try:
        with socket.socket(socket.AF_INET6) as place:
            place.bind(("::1", 0))
    except OSError:
        return False
    return True


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost", "LOCALHOST:1", "[::1]", "[::1]:8080", "127.0.0.2:1"])
def test_its_own_names_are_known(api, host):
    assert api.get(STATUS, headers={"Host": host}).status_code == 200


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8080", "127.0.0.1.evil.example", "10.0.0.1", "[::1", ""]
)
def test_another_name_is_a_problem_that_says_so(api, daemon, host):
    told = problem(api.get(STATUS, headers={"Host": host}), 400, "wrong-host")
    assert "is no name of this computer; ask 127.0.0.1, [::1] or localhost" in told["detail"]
    problem(api.post("/api/v1/connect", headers={"Host": host}), 400, "wrong-host")
    line = daemon.journal.audits(1)[0]
    assert (line.target, line.outcome) == ("/api/v1/connect", "400")
    assert "is no name of this computer" in line.detail


def test_another_loopback_address_is_served(tmp_path):
    with small_daemon(tmp_path, sensor_px=320, connected=False, host="127.0.0.2") as daemon, api_of(daemon) as api:
        assert api.get(STATUS, headers={"Host": "127.0.0.2:8080"}).status_code == 200


@pytest.mark.skipif(not has_ipv6(), reason="this computer has no ::1")
def test_it_is_served_at_the_loopback_address_of_ipv6(tmp_path):
    with serving(configuration(tmp_path, 320, host="::1"), "--no-connect") as served:
        assert served.url.startswith("http://[::1]:")
        assert served.estop_url.startswith("http://[::1]:")
        with Client(served.url, operator="anna") as client:
            assert client.status().state.value == "offline"
            assert client.estop("smoke").by == "anna: smoke"
        with listening("::1", 0) as place:  # nobody answers there
            away = f"http://[::1]:{place.getsockname()[1]}"
            with Client(away, operator="anna", estop_url=served.estop_url) as client:
                assert client.estop("smoke").by == "anna, e-stop listener, ::1: smoke"
