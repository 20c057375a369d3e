"""The HTML page of a reproduction: a verdict table, then each experiment with its claims, tables and figures."""

from pathlib import Path
from typing import Any

from slam_gym.report import Cell, Column, Section, Table, embedded, render_page
from slam_gym.reproduce.experiment import PAPERS
from slam_gym.reproduce.runner import load
from slam_gym.reproduce.verdict import FAILS, HOLDS, IN_PART, NOT, NOT_RUN, REPRODUCES, TIE

CLAIMS = ("statement", "paper", "ours", "outcome", "basis")
CLAIM_TITLES = ("claim", "paper", "ours", "outcome", "how decided")
CHOICES = ("what", "taken", "why")
CHOICE_TITLES = ("left open", "taken", "why")
BASIS = "Statements decide by 95 % intervals over runs, never by eye; see slam_gym/reproduce/verdict.py for the rules."


def write_page(folder: Path, command: str) -> Path:
    """Write `report.html` from what lies in the folder; returns its path.

    Raises:
        FileNotFoundError: no results there.
    """
    found = load(folder)
    results = found["experiments"]
    page = render_page(
        title="Four papers, reproduced",
        summary=[headline(results), BASIS],
        sections=[_overview(results), *(_section(result, folder / result["name"] / "figures") for result in results)],
        command=command,
        provenance=[(f"{name} version", text) for name, text in found["versions"].items()]
        + [(f"{result['name']}, seconds", str(result["seconds"])) for result in results],
    )
    path = folder / "report.html"
    path.write_text(page, encoding="utf-8")
    return path


def headline(results: list[dict[str, Any]]) -> str:
    """How many got which verdict."""
    verdicts = [result["verdict"] for result in results]
    counted = [f"{kind}: {verdicts.count(kind)}" for kind in (REPRODUCES, IN_PART, NOT, NOT_RUN) if kind in verdicts]
    return f"Of {len(results)} experiments, {', '.join(counted)}."


def _overview(results: list[dict[str, Any]]) -> Section:
    rows = [
        [Cell(text, text, "bad" if text == NOT else "") for text in (r["name"], r["source"], r["verdict"], _held(r))]
        for r in results
    ]
    titles = ("experiment", "of the paper", "verdict", "claims that hold")
    return Section("Verdicts", [], [Table("All experiments", _columns(titles), rows)])


def _held(result: dict[str, Any]) -> str:
    outcomes = [claim["outcome"] for claim in result["claims"]]
    return f"{outcomes.count(HOLDS)} of {len(outcomes)}"


def _section(result: dict[str, Any], figures: Path) -> Section:
    sentences = [PAPERS[result["paper"]] + ": " + result["source"] + ".", *result["remarks"]]
    if result["missing"]:
        sentences.append(f"Not run: {result['missing']}.")
    if result["settings"]["quick"]:
        sentences.append("A quick look with few runs: intervals are wide, and verdicts mean little.")
    tables = [_records("Claims", CLAIM_TITLES, CLAIMS, result["claims"])]
    tables += [
        Table(
            grid["title"],
            _columns(grid["columns"]),
            [[_cell(text) for text in row] for row in grid["rows"]],
            grid["note"],
        )
        for grid in result["grids"]
    ]
    tables.append(_records("Settings that the paper leaves open", CHOICE_TITLES, CHOICES, result["choices"]))
    pictures = [embedded(figures / item["file"], item["caption"]) for item in result["figures"]]
    title = f"{result['name']}: {result['verdict']}"
    return Section(title, sentences, [table for table in tables if table.rows], pictures)


def _records(title: str, titles: tuple[str, ...], keys: tuple[str, ...], records: list[dict[str, str]]) -> Table:
    bad = (FAILS, TIE)
    rows = [[Cell(r[key], r[key], "bad" if r[key] in bad else "wrap") for key in keys] for r in records]
    return Table(title, _columns(titles), rows)


def _columns(titles: tuple[str, ...]) -> list[Column]:
    return [Column(title, title) for title in titles]


def _cell(text: str) -> Cell:
    """Sorted by its first number, if it begins with one."""
    first = text.split()[0] if text.split() else ""
    try:
        return Cell(text, float(first))
    except ValueError:
        return Cell(text, text)
