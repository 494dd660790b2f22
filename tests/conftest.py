"""Options and fixtures that all tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

from tests.drivers import own_network
from tests.drivers.own_network import pytest_runtest_protocol

__all__ = ["pytest_runtest_protocol"]

# here, since tests beside the drivers' inherit them too and may be collected first
pytest.register_assert_rewrite(
    "tests.drivers.contract.axis_contract",
    "tests.drivers.contract.camera_contract",
    "tests.drivers.contract.pressure_contract",
)

ROOT = Path(__file__).resolve().parents[1]


class _Child:
    """What a child in a network of its own does beside testing: it hands its reports over."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        own_network.report_to_file(self._config, report)


def pytest_configure(config: pytest.Config) -> None:
    if own_network.inside():
        from drivers.emulators.gige.loopback import bring_up

        bring_up()
        config.pluginmanager.register(_Child(config))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="also run the soaks and long series")


#: A busy machine is no failure: pytest has time limits of its own.
settings.register_profile("bscd", deadline=None)
settings.load_profile("bscd")

#: Files that take longest, the longest first: they begin first, so that none is left to run alone at the end.
LONGEST = (
    "cli/test_demo.py",
    "drivers/test_rig_through_drivers.py",
    "daemon/test_crash.py",
    "procedures/measuring/test_live.py",
    "procedures/measuring/test_live_endings.py",
    "procedures/measuring/test_pooled.py",
    "procedures/measuring/test_report.py",
    "procedures/measuring/test_live_recording.py",
    "cli/test_foreign_folder.py",
    "procedures/measuring/test_faults.py",
    "procedures/measuring/test_inflation.py",
    "drivers/stages/test_stage_faults.py",
    "docs/test_tutorial.py",
    "procedures/test_streaming.py",
    "cli/test_foreign_measuring.py",
    "drivers/cameras/aravis/test_faults.py",
    "drivers/cameras/aravis/test_wire_faults.py",
    "drivers/jacks/test_modbus_wire_faults.py",
    "analysis/test_report_page.py",
)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    begins = {ROOT / "tests" / name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: begins.get(item.path, len(LONGEST)))
    if config.getoption("--slow"):
        return
    kept = [item for item in items if "slow" not in item.keywords]
    config.hook.pytest_deselected(items=[item for item in items if "slow" in item.keywords])
    items[:] = kept


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real images; skips the test where it is absent."""
    folder = Path(os.environ.get("BSCD_DATA", ROOT.parent / "shared/data"))
    if not folder.is_dir():
        pytest.skip(f"no real images at {folder}; set BSCD_DATA")
    return folder
