import pytest

pytest.register_assert_rewrite("tests.drivers.contract.axis_contract")
