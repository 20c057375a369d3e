import base64
import math
import re
import shutil

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.stats import chi2

from slam_gym import palette, plots
from slam_gym.evaluation import compare
from slam_gym.report import Column, write_report
from slam_gym.results import Results


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("report") / "results"
    compare("open", ["ekf", "dead-reckoning"], runs=3, steps=40, out=out, jobs=1, command="slam-gym compare <open>")
    return out


@pytest.fixture(scope="module")
def page(folder):
    return write_report(folder).read_text(encoding="utf-8")


def test_the_page_needs_nothing_from_outside(page):
    assert not re.search(r"(?:src|href)=\"(?!data:)", page)
    assert "<link" not in page and "@import" not in page


def test_every_picture_is_embedded_and_kept_as_png(page, folder):
    embedded = re.findall(r"data:image/png;base64,([^\"]+)", page)
    kept = {path.read_bytes() for path in (folder / "figures").glob("*.png")}
    assert {base64.b64decode(data) for data in embedded} == kept
    assert len(kept) == 5


def test_values_that_differ_in_sign_alone_keep_their_own_pictures(tmp_path):
    out = tmp_path / "swept"
    compare("open", ["ekf"], runs=1, steps=5, out=out, jobs=1, sweep={"robot.turn_bias": [-0.1, 0.1]})
    page = write_report(out).read_text(encoding="utf-8")
    assert len(list((out / "figures").glob("*.png"))) == page.count("data:image/png") > 0


def test_what_a_user_typed_is_escaped(page):
    assert "slam-gym compare &lt;open&gt;" in page


def test_the_table_holds_the_summary(page, folder):
    summary = Results.load(folder).summary.set_index("estimator")
    for name in ("ekf", "dead-reckoning"):
        assert f"{summary.loc[name, 'robot_error_rmse']:.3f} ±" in page


def test_columns_without_values_are_left_out(page):
    words = re.sub(r"data:image/png;base64,[^\"]+", "", page)
    assert "GOSPA" not in words and not re.search(r"\bnan\b", words, re.IGNORECASE)


def test_a_folder_without_results_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="no finished results"):
        write_report(tmp_path)


def test_a_run_that_breaks_is_still_drawn(folder, tmp_path):
    broken = tmp_path / "broken"
    shutil.copytree(folder, broken)
    results = Results.load(broken)
    for frame in (results.summary, results.runs, results.series, results.tracks):
        numbers = frame.select_dtypes(np.float64).columns
        frame.loc[frame["estimator"] == "ekf", numbers] = np.inf
    results.save()
    assert write_report(broken).stat().st_size > 10_000


@pytest.mark.parametrize(
    ("value", "text", "kind"),
    [(1.2345, "1.234", ""), (4.0, "4.000", "bad"), (math.nan, "-", ""), (2.5e7, "2.5e+07", "bad")],
)
def test_cells(value, text, kind):
    cell = Column("nees", "NEES", expected=2.0).cell({"nees": value})
    assert (cell.text, cell.kind) == (text, kind)


def test_the_ellipse_holds_95_percent():
    cov = np.array([[2.0, 0.7], [0.7, 0.5]])
    axis = Figure().subplots()
    plots.add_ellipse(axis, 1.0, -2.0, cov[0, 0], cov[0, 1], cov[1, 1], "k")
    ellipse = axis.patches[0]
    turn = np.linspace(0.0, 2.0 * np.pi, 50)
    unit_circle = np.column_stack([np.cos(turn), np.sin(turn)])
    edge = ellipse.get_patch_transform().transform(unit_circle) - (1.0, -2.0)
    distance = np.einsum("ij,jk,ik->i", edge, np.linalg.inv(cov), edge)
    np.testing.assert_allclose(distance, chi2.ppf(0.95, 2), rtol=1e-9)


def test_styles_stay_apart_beyond_the_colours():
    look = palette.styles([f"filter {i}" for i in range(20)])
    assert len(set(look.values())) == 20
    assert palette.rgb("#E69F00") == (230, 159, 0)
