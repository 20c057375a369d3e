import subprocess
import sys
import time
from importlib import import_module

import pytest

import slam_gym.evaluation
from slam_gym import cli
from slam_gym.cli_words import respelled
from slam_gym.commands.compare import parse_shard
from slam_gym.specs import Spec, parse_options, parse_settings


def test_help_lists_every_command(capsys):
    assert cli.main([]) == 0
    text = capsys.readouterr().out
    assert all(f"  {name} " in text for name in cli.COMMANDS)
    assert cli.main(["--help"]) == 0
    assert capsys.readouterr().out == text
    assert max(map(len, text.splitlines())) <= 100


def test_help_needs_nothing_heavy():
    code = (
        "import sys; from slam_gym.cli import main; main(['--help']);"
        "print([m for m in ('pandas', 'matplotlib', 'pygame', 'tyro', 'rich', 'joblib', 'scipy') if m in sys.modules])"
    )
    started = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert time.perf_counter() - started < 5.0  # under one on a machine that does nothing else


def test_an_unknown_command_names_the_nearest(capsys):
    assert cli.main(["comapre"]) == 2
    assert "unknown command. Did you mean 'compare'? Commands: compare, run" in capsys.readouterr().err


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_every_command_explains_itself(name, capsys):
    with pytest.raises(SystemExit) as left:
        cli.main([name, "--help"])
    assert left.value.code == 0
    text = capsys.readouterr().out
    assert "slam-gym " + name in text
    assert "xample" in text


@pytest.mark.parametrize(("name", "typed", "meant"), [
    ("run", "--scenario open --steps 5", "open --steps 5"),
    ("run", "--steps 5 --scenarios=open", "open --steps 5"),
    ("watch", "--estimator ekf cdkf --scenario open", "open --estimators ekf cdkf"),
    ("compare", "--scenario open revisit --policy pursuit", "--scenarios open revisit --policies pursuit"),
    ("train", "--scenarios open --estimators=ekf --seeds 1 2", "--scenario open --estimator=ekf --seeds 1 2"),
    ("evaluate", "--policy runs/a runs/b --runs 9", "runs/a runs/b --runs 9"),
    ("replay", "mrclam PATH --estimator ekf ri-ekf", "mrclam PATH --estimators ekf ri-ekf"),
    ("export", "mrclam --nosuch 1", "mrclam --nosuch 1"),
])  # fmt: skip
def test_singular_plural_and_place_are_the_same(name, typed, meant):
    module, _, command = cli.COMMANDS[name][0].partition(":")
    assert respelled(getattr(import_module(module), command), typed.split()) == meant.split()


@pytest.mark.parametrize(("arguments", "message"), [
    ("compare ekf ri-ekf:iterations=2", "'--estimators ekf ri-ekf:iterations=2'"),
    ("compare open pursuit --runs 2", "'--scenarios open --policies pursuit'"),
    ("train discovery", "'--scenario discovery'"),
    ("doctor everything", "--help"),
])  # fmt: skip
def test_words_without_their_option_are_told_it(arguments, message, capsys):
    assert cli.main(arguments.split()) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1


def test_the_version_is_the_packages(capsys):
    import slam_gym

    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"slam-gym {slam_gym.__version__}\n"


def test_errors_are_one_line_and_a_traceback_only_on_demand(capsys):
    call = ["report", "no-such-folder"]
    assert cli.main(call) == 2
    text = capsys.readouterr().err
    assert text.startswith("slam-gym report: no results folder 'no-such-folder'")
    assert "Traceback" not in text
    with pytest.raises(FileNotFoundError):
        cli.main([*call, "--debug"])


def test_an_oserror_is_shown_without_its_number():
    assert cli.message(OSError(28, "disk full")) == "disk full"
    assert cli.message(FileNotFoundError(2, "No such file", "a.txt")) == "No such file: 'a.txt'"
    assert cli.message(KeyError()) == "KeyError"


def test_ctrl_c_ends_quietly(monkeypatch, capsys):
    class Interrupted:
        def run(self):
            raise KeyboardInterrupt

    monkeypatch.setattr(cli, "_load", lambda *_: Interrupted())
    assert cli.main(["compare"]) == 130
    assert "Interrupted" in capsys.readouterr().err


@pytest.mark.parametrize("done", [True, False])
def test_a_comparison_that_was_stopped_says_how_to_go_on(monkeypatch, capsys, tmp_path, done):
    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(slam_gym.evaluation, "compare", stopped)
    call = ["compare", "--out", str(tmp_path / "results"), "--estimators", "ekf"]
    if done:
        (tmp_path / "results/parts/000").mkdir(parents=True)
        (tmp_path / "results/parts/000/000000.npz").touch()
    assert cli.main(call) == 130
    assert ("the same command with --resume goes on" in capsys.readouterr().err) == done


def test_names_take_options_after_a_colon():
    assert Spec.parse("ekf") == Spec("ekf", "ekf")
    spec = Spec.parse("slamto:particles=500,resample=0.5,proposal=prior")
    assert (spec.name, spec.options) == ("slamto", {"particles": 500, "resample": 0.5, "proposal": "prior"})
    assert Spec.parse(("ekf", {"gate": 9})).label == "ekf:gate=9"
    assert Spec.parse(spec) is spec


def test_settings_are_json_where_they_can_be():
    assert parse_settings(["a.b=5", "c=[1, 2]", "d=true", "e=ring", "f=x=y"]) == {
        "a.b": 5, "c": [1, 2], "d": True, "e": "ring", "f": "x=y",
    }  # fmt: skip
    assert parse_options('{"ekf": {"gate": 9}}', ["ekf"]) == {"ekf": {"gate": 9}}
    assert parse_shard("2/3") == (2, 3)
