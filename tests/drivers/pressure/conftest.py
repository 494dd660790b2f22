import pytest

pytest.register_assert_rewrite("tests.drivers.contract.pressure_contract")
