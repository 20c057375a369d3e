"""`slam-gym benchmark`: how fast it is here, against what people use today."""

import json
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal


@dataclass(frozen=True)
class Benchmark:
    """Measure environments and filters against NumPy, Gymnasium, FilterPy, Stone Soup, GTSAM and BLAS.

    All rows of a table are measured in turn in one process, and the least time of each counts: ratios hold even on a
    busy machine, times do not. Packages that are not installed are left out:
    `pip install -c constraints.txt ".[bench]"` adds them.

    Examples:
      slam-gym benchmark --quick                    a look, about a minute
      slam-gym benchmark --write BENCHMARKS.md      the whole, some minutes, as a page
      slam-gym benchmark --only decisions           how long policies take to decide
    """

    quick: bool = False
    """Fewer sizes, fewer rounds."""
    only: tuple[Literal["environment", "filters", "blas", "decisions", "training", "growth"], ...] = ()
    """Sections to measure; none: all."""
    write: Path | None = None
    """Write the tables to this Markdown file too."""
    json: Path | None = None
    """Write the numbers to this file too."""

    def run(self) -> int:
        """Measure, print, write."""
        from rich.console import Console
        from rich.markdown import Markdown

        from slam_gym.benchmark.measure import QUICK, Size, measure
        from slam_gym.benchmark.page import page
        from slam_gym.commands.compare import progress_bar

        for path in (self.write, self.json):
            if path is not None and not path.parent.is_dir():
                raise ValueError(f"there is no folder {str(path.parent)!r} to write {path.name!r} to; make it first")
        with progress_bar("measurements") as progress:
            found = measure(QUICK if self.quick else Size(), progress, self.only)
        text = page(found, shlex.join(["slam-gym", *sys.argv[1:]]))
        Console().print(Markdown(text))
        if self.write is not None:
            self.write.write_text(text, encoding="utf-8")
        if self.json is not None:
            self.json.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
        return 0
