"""The checks behind `estimators.testing`."""

from estimators._checks import beliefs, runs, sweeps
from estimators._checks.contract import CHECKS, BrokenContractError, Subject, edited, without

__all__ = ["CHECKS", "BrokenContractError", "Subject", "beliefs", "edited", "runs", "sweeps", "without"]
