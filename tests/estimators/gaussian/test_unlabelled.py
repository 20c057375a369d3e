"""Filters of the family on returns that nobody has labelled."""

import pytest

from estimators.testing import checks


@pytest.mark.parametrize("check", checks("ekf", association="jcbb"), ids=str)
def test_contract(check):
    check()
