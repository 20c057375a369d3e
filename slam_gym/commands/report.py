"""`slam-gym report`: draw a results folder again."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Report:
    """Write the HTML page and the pictures of a results folder.

    `compare` and `replay` do so themselves; use this after `merge`, or after an update of slam-gym.

    Example: slam-gym report results/compare-default
    """

    results: Annotated[Path, tyro.conf.Positional]
    """Folder that `compare`, `replay` or `merge` wrote."""

    def run(self) -> int:
        """Write the page and say where it is."""
        from slam_gym.report import write_report

        print(f"Report: {write_report(self.results)}")
        return 0
