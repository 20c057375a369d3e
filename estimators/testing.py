"""Check that an estimator keeps the contract, whoever wrote it.

>>> from estimators.testing import check_estimator
>>> len(check_estimator("dead-reckoning")) > 15
True

In a test suite, one test per check:

>>> import pytest
>>> from estimators.testing import checks
>>> @pytest.mark.parametrize("check", checks("dead-reckoning"), ids=str)
... def test_contract(check):
...     check()
"""

from dataclasses import dataclass
from typing import Any

from estimators import _checks
from estimators.interface import Estimator
from estimators.registry import get


class CheckFailedError(AssertionError):
    """A check of the contract failed; `check` is its name."""

    def __init__(self, check: str, message: str) -> None:
        super().__init__(f"{check}: {message}")
        self.check = check


@dataclass(frozen=True, slots=True)
class Check:
    """One named check of one estimator; call it."""

    name: str
    subject: _checks.Subject

    def __str__(self) -> str:
        return self.name

    def __call__(self) -> None:
        """Run the check.

        Raises:
            CheckFailedError: the estimator breaks the contract here; the message says what was expected.
        """
        try:
            _checks.CHECKS[self.name](self.subject)
        except _checks.BrokenContractError as broken:
            raise CheckFailedError(self.name, str(broken)) from None
        except Exception as error:
            raise CheckFailedError(self.name, f"it raised {type(error).__name__}: {error}") from error


def checks(estimator: str | type[Estimator], **options: Any) -> list[Check]:
    """Every check of an estimator, to be called one by one.

    Args:
        estimator: a class, or a name from the registry.
        **options: passed to its constructor.
    """
    cls = get(estimator) if isinstance(estimator, str) else estimator
    return [Check(name, _checks.Subject(cls, options)) for name in _checks.CHECKS]


def check_estimator(estimator: str | type[Estimator], **options: Any) -> list[str]:
    """Run every check; takes a few seconds.

    Args:
        estimator: a class, or a name from the registry.
        **options: passed to its constructor.

    Returns:
        The names of the checks, all passed.

    Raises:
        CheckFailedError: the first check that fails, named, with what was expected and what came.
    """
    done = []
    for check in checks(estimator, **options):
        check()
        done.append(check.name)
    return done
