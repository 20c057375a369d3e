"""`slam-gym reproduce`: tables and figures of papers, each with a verdict."""

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

COLOURS = {"reproduces": "green", "reproduces in part": "yellow", "does not reproduce": "red", "not run": "dim"}


@dataclass(frozen=True)
class Reproduce:
    """Repeat tables and figures of four papers, and say of each claim whether it holds.

    Each experiment measures again what the paper printed, puts the number into the interval that a repetition would
    give, and draws the figure in the paper's layout. Results, figures and report.html end in --out.

    Examples:
      slam-gym reproduce list                        what there is, with the verdicts on record
      slam-gym reproduce slamto-1 --quick            a look with few runs, under a minute
      slam-gym reproduce all                         everything at full size: some ten minutes on two cores
      slam-gym reproduce all --resume                go on after Ctrl-C or a crash
      slam-gym reproduce cdkf-sparse --webmap PATH   on the published map, a folder with webmap_landmarks.csv
    """

    names: Annotated[tuple[str, ...], tyro.conf.Positional] = ("list",)
    """`list`, `all`, or names of experiments."""
    quick: bool = False
    """Few runs, under a minute each; intervals are wide and verdicts mean little."""
    webmap: Path | None = None
    """Folder with webmap_landmarks.csv and webmap_waypoints.csv, the map of Tian et al. 2010; none: a generated one."""
    mrclam: Path | None = None
    """Folder of an MRCLAM data set, for slamto-robots."""
    batches: int | None = None
    """Batches of 45 runs of the CDKF's loops instead of 10: most of the time goes there."""
    jobs: int | None = None
    """Processes; default: one per CPU. Changes no number but times."""
    out: Path | None = None
    """Folder of the results; default: results/reproduce, or results/reproduce-quick."""
    resume: bool = False
    """Go on with what is done in --out."""
    write_markdown: Path | None = None
    """Write REPRODUCTION.md anew from the results that come with slam-gym, and do nothing else."""
    publish: Path | None = None
    """Root of slam-gym's source tree: put the results of --out there, with figures and REPRODUCTION.md."""

    def run(self) -> int:
        """List, run, or write."""
        from rich.console import Console

        console = Console(highlight=False)
        out = self.out or Path("results") / ("reproduce-quick" if self.quick else "reproduce")
        if self.write_markdown is not None:
            from slam_gym.reproduce.markdown import kept_results, markdown

            self.write_markdown.write_text(markdown(kept_results()), encoding="utf-8")
            console.print(f"Written: {self.write_markdown}")
        elif self.names == ("list",) and self.publish is None:
            print_list(console)
        else:
            self._work(console, out)
        return 0

    def _work(self, console: Any, out: Path) -> None:
        from slam_gym.reproduce import catalogue
        from slam_gym.reproduce.markdown import publish
        from slam_gym.reproduce.page import write_page
        from slam_gym.reproduce.runner import run_all
        from slam_gym.reproduce.study import Study

        if self.names != ("list",):
            from slam_gym.commands.compare import progress_bar

            names = catalogue.names() if self.names == ("all",) else list(dict.fromkeys(self.names))
            check_folders(self.webmap, self.mrclam)
            with progress_bar() as progress:
                study = Study(out, quick=self.quick, batches=self.batches, jobs=self.jobs, webmap=self.webmap,
                              mrclam=self.mrclam,
                              progress=progress)  # fmt: skip
                run_all(names, study, resume=self.resume, report=lambda result: print_result(console, result))
            console.print(f"Report: {write_page(out, shlex.join(['slam-gym', *sys.argv[1:]]))}", soft_wrap=True)
        if self.publish is not None:
            publish(out, self.publish)
            console.print(f"Published in {self.publish}", soft_wrap=True)


def check_folders(webmap: Path | None, mrclam: Path | None) -> None:
    """See that the user's data are where they are said to be.

    Raises:
        FileNotFoundError: they are not.
    """
    from slam_gym.reproduce.cdkf_batches import LANDMARKS_FILE, WAYPOINTS_FILE

    missing = [
        name for name in (LANDMARKS_FILE, WAYPOINTS_FILE) if webmap is not None and not (webmap / name).is_file()
    ]
    if missing:
        raise FileNotFoundError(f"--webmap {str(webmap)!r} needs {' and '.join(missing)} (columns x_m, y_m)")
    if mrclam is not None and not list(mrclam.glob("Robot*_Odometry.dat*")):
        raise FileNotFoundError(
            f"--mrclam {str(mrclam)!r} holds no RobotN_Odometry.dat; name the data set's own folder"
        )


def print_list(console: Any) -> None:
    """Every experiment with the verdict on record."""
    from rich.table import Table

    from slam_gym.reproduce import catalogue
    from slam_gym.reproduce.markdown import kept_results

    kept = {result["name"]: result["verdict"] for result in kept_results()["experiments"]}
    table = Table(box=None, padding=(0, 1), header_style="bold")
    for title in ("experiment", "of the paper", "what", "on record"):
        table.add_column(title)
    for name in catalogue.names():
        experiment, verdict = catalogue.get(name), kept.get(name, "-")
        table.add_row(name, experiment.source, experiment.summary, f"[{COLOURS.get(verdict, 'dim')}]{verdict}[/]")
    console.print(table)


def print_result(console: Any, result: dict[str, Any]) -> None:
    """One experiment's verdict and claims, as it comes."""
    from rich.markup import escape

    colour = COLOURS[result["verdict"]]
    console.print(f"[bold]{result['name']}[/] ({result['source']}): [{colour}]{result['verdict']}[/]")
    if result["missing"]:
        console.print(f"  {result['missing']}", soft_wrap=True)
    for claim in result["claims"]:
        numbers = escape(f"paper {claim['paper']}, ours {claim['ours']}")
        console.print(f"  {claim['outcome']:>19}  {escape(claim['statement'])}: {numbers}", soft_wrap=True)
