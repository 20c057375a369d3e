"""One self-contained HTML page of a results folder: what was found, tables that sort, pictures, how it was made.

No network, no script other than the sorting of tables; the pictures are embedded and also kept as PNG files.
"""

import base64
import math
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment
from matplotlib.figure import Figure

from slam_gym import plots, policies
from slam_gym.gaps import METRICS, share_text
from slam_gym.results import Results, file_stem
from slam_gym.specs import is_reference
from slam_gym.tables import PAIRED, UNBOUNDED

NEES_SUSPECT = 1.5  # times its expectation: marked in the table


@dataclass(frozen=True, slots=True)
class Cell:
    """One table cell: what is printed, what is sorted by, and "bad" or "small"."""

    text: str
    value: float | str
    kind: str = ""


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a table, taken from a summary column."""

    key: str
    title: str
    format: str = ".3f"
    help: str = ""
    expected: float = math.nan  # what an honest filter scores; far above is marked
    spread: str = ""  # column with the standard deviation over runs
    scale: float = 1.0

    def cell(self, row: dict[str, Any]) -> Cell:
        """The row's value, formatted."""
        value = row.get(self.key)
        if isinstance(value, str):
            return Cell(value, value)
        if value is None or not isinstance(value, (int, float)) or math.isnan(value):
            return Cell("-", "")
        number = float(value) * self.scale
        text = format(number, self.format) if abs(number) < 1e5 else f"{number:.1e}"
        if self.spread and math.isfinite(row.get(self.spread, math.nan)):
            text += f" ± {row[self.spread] * self.scale:{self.format}}"
        return Cell(text, number, "bad" if number > NEES_SUSPECT * self.expected else "")


@dataclass(slots=True)
class Table:
    """A sortable table."""

    title: str
    columns: list[Column]
    rows: list[list[Cell]]
    note: str = ""


@dataclass(slots=True)
class Section:
    """One scenario under one policy."""

    title: str
    sentences: list[str]
    tables: list[Table] = field(default_factory=list)
    figures: list[dict[str, str]] = field(default_factory=list)


ACCURACY = (
    Column("estimator", "estimator"),
    Column("robot_error_rmse", "robot RMSE [m]", spread="robot_error_rmse_sd"),
    Column("heading_error_rmse", "heading RMSE [rad]", ".4f"),
    Column("target_error_rmse", "target RMSE, world [m]", spread="target_error_rmse_sd"),
    Column("target_error_rel_rmse", "target RMSE, robot frame [m]"),
    Column("target_heading_error_rmse", "target heading RMSE [rad]"),
    Column("landmark_error_rmse", "landmark RMSE [m]"),
    Column("lost_share", "lost [%]", ".1f", "share of time with the target unseen for more than 2 s", scale=100.0),
    Column("find_time", "found after [s]", ".1f", "until the target is first seen; the run's length where it never is"),
    Column("predict_us", "predict [us]", ".2f", "per lane and step"),
    Column("update_us", "update [us]", ".2f", "per lane and sweep"),
)
AGES = (
    Column("estimator", "estimator"),
    Column("target_error_lt2", "RMSE, seen < 2 s ago [m]"),
    Column("target_error_2_15", "2-15 s [m]"),
    Column("target_error_gt15", "> 15 s [m]"),
    Column("target_nees_lt2", "NEES, < 2 s", ".2f", expected=2.0),
    Column("target_nees_2_15", "NEES, 2-15 s", ".2f", expected=2.0),
    Column("target_nees_gt15", "NEES, > 15 s", ".2f", expected=2.0),
)


def _consistency_columns(summary: pd.DataFrame) -> list[Column]:
    columns = [Column("estimator", "estimator")]
    for kind, dof in (("pose", 3), ("target", 2), ("landmark", 2)):
        columns += [
            Column(f"{kind}_nees_mean", f"{kind} NEES ({dof})", ".2f", f"{dof} when honest", expected=dof),
            Column(f"{kind}_nees_median", "median", ".2f"),
        ]
        if kind == UNBOUNDED:
            continue
        batch = int(summary[f"{kind}_nees_batch"].max()) if f"{kind}_nees_batch" in summary else 0
        columns += [
            Column(f"{kind}_nees_in95_run", "inside, each run [%]", ".0f", "share inside one run's 95 % bounds",
                   scale=100.0),
            Column(f"{kind}_nees_in95_mean", f"inside, mean of {batch} [%]", ".0f",
                   "share of steps at which the mean over a batch lies inside its 95 % bounds", scale=100.0),
        ]  # fmt: skip
    return [*columns, Column("diverged", "diverged runs", ".0f")]


def write_report(results: str | Path | Results) -> Path:
    """Write `report.html` and `figures/*.png` into a results folder; returns the page's path.

    Raises:
        FileNotFoundError: the folder holds no results.
    """
    found = results if isinstance(results, Results) else Results.load(results)
    sections = [_section(found, *key) for key in _keys(found.summary)]
    page = render_page(
        title=_title(found.summary),
        summary=_headline(found),
        sections=sections,
        command=found.config.get("command", ""),
        provenance=_provenance(found.config),
    )
    path = Path(found.path) / "report.html"
    path.write_text(page, encoding="utf-8")
    return path


def render_page(
    *, title: str, summary: list[str], sections: list[Section], command: str, provenance: list[tuple[str, str]]
) -> str:
    """The whole page: headline sentences, sections, and how it was made."""
    source = files("slam_gym").joinpath("templates/report.html").read_text(encoding="utf-8")
    template = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True).from_string(source)
    return template.render(title=title, summary=summary, sections=sections, command=command, provenance=provenance)


def _keys(summary: pd.DataFrame) -> list[tuple[str, str]]:
    return list(dict.fromkeys(zip(summary["scenario"], summary["policy"], strict=True)))


def _pick(frame: pd.DataFrame, scenario: str, policy: str) -> pd.DataFrame:
    return frame[(frame["scenario"] == scenario) & (frame["policy"] == policy)] if len(frame) else frame


def _title(summary: pd.DataFrame) -> str:
    return f"{', '.join(dict.fromkeys(summary['scenario']))}: {', '.join(dict.fromkeys(summary['estimator']))}"


def _headline(found: Results) -> list[str]:
    summary = found.summary
    runs = int(summary["n_runs"].max())
    counted = ((len(set(summary[kind])), kind.removesuffix("y")) for kind in ("estimator", "scenario", "policy"))
    sizes = [f"{n} {kind}{_ending(kind, n)}" for n, kind in counted]
    first = f"{sizes[0]}, {sizes[1]}, {sizes[2]}, {runs} run{'s' * (runs != 1)} each, on the same random draws."
    diverged = summary.groupby("estimator", sort=False)["diverged"].sum()
    broken = ", ".join(f"{name} ({int(n)})" for name, n in diverged.items() if n > 0)
    return [first, f"Diverged runs: {broken}." if broken else "No run diverged."]


def _ending(kind: str, n: int) -> str:
    if kind == "polic":
        return "y" if n == 1 else "ies"
    return "" if n == 1 else "s"


def _sentences(summary: pd.DataFrame, paired: pd.DataFrame) -> list[str]:
    scored = summary[summary["pose_nees_mean"].notna()]
    rows = [row for row in scored.to_dict("records") if not is_reference(str(row["estimator"]))]
    if not rows:
        return []
    honest = min(rows, key=lambda row: abs(math.log(max(row["pose_nees_mean"], 1e-9) / 3.0)))
    accurate = min(rows, key=lambda row: row["robot_error_rmse"])
    sentences = [
        f"Closest to honest: {honest['estimator']}, pose NEES {honest['pose_nees_mean']:.2f} (3 is right). "
        f"Least robot error: {accurate['estimator']}, RMSE {accurate['robot_error_rmse']:.3f} m."
    ]
    if len(paired) and "sentence" in paired:
        sentences += list(paired["sentence"])
    return sentences


def _section(found: Results, scenario: str, policy: str) -> Section:
    summary, runs = _pick(found.summary, scenario, policy), _pick(found.runs, scenario, policy)
    told = " (told the truth)" * policies.is_reference(policy)
    section = Section(
        f"{scenario}, policy {policy}{told}", _sentences(summary, _pick(found.paired, scenario, policy).head(0))
    )
    section.tables = [
        _table("Accuracy and cost", ACCURACY, summary, "± is the standard deviation over runs."),
        _table("Consistency", _consistency_columns(summary), summary,
               "In brackets what an honest filter scores; marked where it is over one and a half times that."),
        _table("Target, by time since it was last seen", AGES, summary, "NEES here is the mean."),
        _paired_table(_pick(found.paired, scenario, policy)),
        _gap_table(_pick(found.gaps, scenario, policy)),
    ]  # fmt: skip
    section.tables = [table for table in section.tables if table.rows]
    drawings = _drawings(found, summary, runs, scenario, policy)
    section.figures = [_figure(found, scenario, policy, *drawing) for drawing in drawings]
    return section


def _table(title: str, columns: Any, frame: pd.DataFrame, note: str) -> Table:
    """Columns that hold nothing in any row are left out."""
    present = [c for c in columns if c.key in frame and frame[c.key].notna().any()]
    rows = [[column.cell(row) for column in present] for row in frame.to_dict("records")]
    return Table(title, present, rows if len(present) > 1 else [], note)


def _paired_table(paired: pd.DataFrame) -> Table:
    columns = [
        Column("estimator", "estimator"),
        Column("baseline", "minus"),
        Column("metric", "of"),
        Column("difference", "mean difference", "+.4f"),
        Column("low", "95 % from", "+.4f"),
        Column("high", "to", "+.4f"),
        Column("n", "runs", ".0f"),
    ]
    note = "Run by run on the same seeds; an interval that holds 0 shows no difference."
    words = {name: f"{what} [{unit}]" if unit else what for name, (what, unit) in PAIRED.items()}
    return _table("Paired differences", columns, paired.replace({"metric": words}), note)


def _gap_table(gaps: pd.DataFrame) -> Table:
    columns = [
        Column("estimator", "estimator"),
        Column("metric", "of"),
        Column("baseline", "pursuit"),
        Column("value", "this policy"),
        Column("reference", "oracle"),
        Column("share", "gap closed (95 %)"),
        Column("n", "runs", ".0f"),
    ]
    note = "Share of the way from pursuit to the oracle, which is told where the target is; means over the same worlds."
    words = {name: f"{what} [{unit}]" if unit else what for name, (what, unit) in METRICS.items()}
    shown = gaps.assign(share=[share_text(row) for row in gaps.to_dict("records")]).replace({"metric": words})
    return _table("Gap closed", columns, shown, note)


def _drawings(
    found: Results, summary: pd.DataFrame, runs: pd.DataFrame, scenario: str, policy: str
) -> list[tuple[str, Figure, str]]:
    series = _pick(found.series, scenario, policy)
    tracks, landmarks = _pick(found.tracks, scenario, policy), _pick(found.landmarks, scenario, policy)
    target = bool(len(series)) and bool(series["target_error"].notna().any())
    errors = ("robot_error", "target_error_rel") if target else ("robot_error",)
    consistency = ("pose_nees", "target_nees") if target else ("pose_nees",)
    drawings = []
    if len(tracks):
        caption = "One run: truth and belief with 95 % ellipses; crosses are true landmarks, grey discs opaque pillars."
        drawings.append(("trajectories", plots.trajectories(tracks, landmarks), caption))
    scored = bool(len(series)) and bool(series["robot_error"].notna().any())  # a recording may come without truth
    if scored:
        caption = "NEES over time, mean over runs; the band holds it in 95 % of cases if the filter is honest."
        drawings.append(("nees", plots.nees_over_time(series, consistency), caption))
        drawings.append(("errors", plots.over_time(series, errors), "Errors over time, mean over runs."))
    if scored and runs.groupby("estimator").size().max() > 1:
        caption = "Mean error of each run (dots), middle half and median (bar)."
        drawings.append(("distributions", plots.error_distributions(runs, errors), caption))
    if scored and len(summary) > 1:
        drawings.append(("cost", plots.cost_against_accuracy(summary), "Cost against accuracy."))
    return drawings


def _figure(found: Results, scenario: str, policy: str, name: str, figure: Figure, caption: str) -> dict[str, str]:
    path = Path(found.path) / "figures" / f"{file_stem(scenario, policy, name)}.png"
    return embedded(save_png(figure, path), caption)


def save_png(figure: Figure, path: Path) -> Path:
    """Draw a figure into a file, the folder made if need be."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, format="png")
    return path


def embedded(picture: Path, caption: str) -> dict[str, str]:
    """A PNG file as the page's template wants it."""
    return {"caption": caption, "data": base64.b64encode(picture.read_bytes()).decode()}


def _provenance(config: dict[str, Any]) -> list[tuple[str, str]]:
    rows = [(key, value) for key, value in config.items() if key not in ("command", "versions")]
    rows += [(f"{name} version", value) for name, value in config.get("versions", {}).items()]
    return [(key.replace("_", " "), str(value)) for key, value in rows]
