import pytest

from tests.drivers import own_network
from tests.drivers.own_network import pytest_runtest_protocol

__all__ = ["pytest_runtest_protocol"]


class _Child:
    """What the child does beside testing: switches its network on and hands its reports over."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        own_network.report_to_file(self._config, report)


def pytest_configure(config: pytest.Config) -> None:
    if own_network.inside():
        from drivers.emulators.gige.loopback import bring_up

        bring_up()
        config.pluginmanager.register(_Child(config))
