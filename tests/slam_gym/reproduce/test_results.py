"""What is run, kept and shown."""

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from slam_gym import cli
from slam_gym.reproduce import catalogue, runner
from slam_gym.reproduce.experiment import Choice, Drawing, Experiment, Grid, Outcome
from slam_gym.reproduce.markdown import FILE, kept_results, markdown, publish
from slam_gym.reproduce.page import write_page
from slam_gym.reproduce.study import Study
from slam_gym.reproduce.verdict import Claim, smaller, verdict

ROOT = Path(__file__).resolve().parents[3]


def test_the_file_is_what_the_results_give():
    assert (ROOT / FILE).read_bytes() == markdown(kept_results()).encode()


def test_the_kept_results_are_complete_and_their_verdicts_follow_from_the_claims():
    results = kept_results()["experiments"]
    assert [result["name"] for result in results] == catalogue.names()
    for result in results:
        assert result["verdict"] == verdict([Claim(**claim) for claim in result["claims"]])
        assert not result["settings"]["quick"]
        for item in result["figures"]:
            assert (ROOT / "docs" / "reproduction" / item["file"]).is_file()


@pytest.fixture
def counted(monkeypatch):
    """An experiment that counts how often it runs."""
    calls = []

    def run(study):
        calls.append(study.folder)
        study.progress("part", 1, 2)
        figure = Figure()
        figure.subplots().plot([1, 2])
        claim = smaller("a < b", np.arange(9.0), np.arange(9.0) + 1.0 + 0.1 * (np.arange(9) % 2))
        return Outcome([claim], [Choice("x", "1", "why")], [Grid("t", ("k", "v"), [["a|b", "2.5 [2, 3]"]], "note")],
                       [Drawing("f", "caption", figure)], ["a remark"])  # fmt: skip

    experiment = Experiment("counted", "wu-2013", "Figure 9", "counts", run)
    monkeypatch.setattr(catalogue, "get", lambda name: experiment)
    return calls


def test_a_finished_experiment_is_not_run_again(counted, tmp_path):
    study = Study(tmp_path / "out")
    first = runner.run_all(["counted"], study)
    assert first["experiments"][0]["verdict"] == "reproduces"
    assert runner.run_all(["counted"], study, resume=True) == first
    assert len(counted) == 1
    runner.run_all(["counted"], Study(tmp_path / "out", quick=True), resume=True)
    assert len(counted) == 2  # other settings
    with pytest.raises(FileExistsError, match="--resume"):
        runner.run_all(["counted"], study)


def test_progress_says_which_of_how_many(counted, tmp_path):
    seen = []
    runner.run_all(["counted", "counted"], Study(tmp_path / "out", progress=lambda *told: seen.append(told)))
    assert seen == [("1/2 counted: part", 1, 2)]


def test_the_page_and_the_source_tree_show_what_was_found(counted, tmp_path):
    out = tmp_path / "out"
    runner.run_all(["counted"], Study(out))
    page = write_page(out, "slam-gym reproduce <counted>").read_text(encoding="utf-8")
    for text in ("counted: reproduces", "a &lt; b", "a remark", "2.5 [2, 3]", "data:image/png", "&lt;counted&gt;"):
        assert text in page
    with pytest.raises(FileNotFoundError, match="source tree"):
        publish(out, tmp_path)
    (tmp_path / "slam_gym" / "reproduce").mkdir(parents=True)
    publish(out, tmp_path)
    written = (tmp_path / FILE).read_text(encoding="utf-8")
    assert "| a/b | 2.5 [2, 3] |" in written
    assert "![caption](docs/reproduction/counted-f.png)" in written
    assert (tmp_path / "docs" / "reproduction" / "counted-f.png").is_file()
    kept = json.loads((tmp_path / "slam_gym" / "reproduce" / "results.json").read_text())
    assert kept == runner.load(out)


def test_the_command_lists_and_writes(capsys, tmp_path):
    assert cli.main(["reproduce"]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in catalogue.names())
    assert cli.main(["reproduce", "--write-markdown", str(tmp_path / FILE)]) == 0
    assert (tmp_path / FILE).read_bytes() == (ROOT / FILE).read_bytes()


def test_the_command_says_what_is_wrong(capsys, tmp_path):
    assert cli.main(["reproduce", "slamto-4", "--out", str(tmp_path / "a")]) == 2
    assert "Did you mean" in capsys.readouterr().err
    assert cli.main(["reproduce", "cdkf-sparse", "--webmap", str(tmp_path), "--out", str(tmp_path / "a")]) == 2
    assert "webmap_landmarks.csv" in capsys.readouterr().err
    assert cli.main(["reproduce", "slamto-robots", "--mrclam", str(tmp_path), "--out", str(tmp_path / "a")]) == 2
    assert "Odometry" in capsys.readouterr().err
