"""`slam-gym merge`: the shards of a comparison in one folder."""

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Merge:
    """Put the folders that `slam-gym compare --shard i/n` wrote together; draws the report.

    Numbers are those of one undivided comparison.

    Example:
      slam-gym merge results/part-1 results/part-2 --out results/all
    """

    folders: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """What the shards wrote, all of them."""
    out: Path
    """A new folder."""

    def run(self) -> int:
        """Merge, print, draw."""
        from rich.console import Console

        from slam_gym.commands.compare import finish
        from slam_gym.commands.summary import print_results
        from slam_gym.evaluation import merge

        results = merge(self.folders, self.out, command=shlex.join(["slam-gym", *sys.argv[1:]]))
        finish(results, Console(), print_results)
        return 0
