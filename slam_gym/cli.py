"""The `slam-gym` command: finds the subcommand, reads its options, turns errors into one clean message.

Nothing heavy is imported before a command runs, so that `slam-gym --help` answers at once. A command is a dataclass
with a method `run() -> int`; its docstring and its fields' docstrings are its `--help`.
"""

import inspect
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any

COMMANDS = {
    "compare": ("slam_gym.commands.compare:Compare", "compare estimators and policies over many runs"),
    "run": ("slam_gym.commands.run:Run", "one episode: numbers, a picture or a video"),
    "watch": ("slam_gym.commands.watch:Watch", "one episode in a live window"),
    "replay": ("slam_gym.commands.replay:Replay", "a recorded robot through the same estimators and metrics"),
    "calibrate": ("slam_gym.commands.calibrate:Calibrate", "fit a recorded robot's numbers, for replay --calibration"),
    "export": ("slam_gym.commands.export:Export", "write a simulated run in a recorded robot's format"),
    "reproduce": ("slam_gym.commands.reproduce:Reproduce", "tables and figures of four papers, each with a verdict"),
    "report": ("slam_gym.commands.report:Report", "draw a results folder again: report.html and pictures"),
    "train": ("agents.sb3.train:Train", "train a policy (PPO, SAC) on many worlds at once"),
    "evaluate": ("agents.evaluate:Evaluate", "judge a policy in worlds it has never seen: win, tie or loss"),
    "merge": ("slam_gym.commands.merge:Merge", "put the shards of one comparison together"),
    "benchmark": ("slam_gym.commands.benchmark:Benchmark", "how fast it is here, against what people use today"),
    "warmup": ("slam_gym.commands.warmup:Warmup", "compile the estimators ahead of their first use"),
    "doctor": ("slam_gym.commands.doctor:Doctor", "versions, compiled kernels, processor, a short speed check"),
    "list": ("slam_gym.commands.list:List", "scenarios, estimators, policies, environments; or the page of one"),
}

HELP = """\
usage: slam-gym COMMAND [options]

Simultaneous localisation and mapping while tracking a moving target: simulate, compare, replay.

{commands}

Start with:
  slam-gym compare                          the default scenario; the first time it compiles
  slam-gym watch --estimators ri-ekf        see what an estimator believes while it drives
  slam-gym list                             what there is
  slam-gym compare --help                   every command explains its options

An option may be singular or plural (--estimator, --estimators), a first word an option as well
(run --scenario open).

  --version    print the version
  --debug      with any command: show the whole traceback of an error
"""

USER_ERRORS = (ValueError, OSError, NotImplementedError, ImportError)
EXIT_ERROR, EXIT_INTERRUPTED = 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit code: 0, 2 for a wrong call, 130 when interrupted."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in words
    words = [word for word in words if word != "--debug"]
    if not words or words[0] in ("-h", "--help", "help"):
        print(help_text())
        return 0
    if words[0] in ("--version", "-V"):
        from slam_gym import __version__

        print(f"slam-gym {__version__}")
        return 0
    try:
        return int(_load(words[0], words[1:]).run())
    except KeyboardInterrupt:
        print("\nInterrupted.", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # `slam-gym list | head`
        sys.stderr.close()
        return 0
    except USER_ERRORS as error:
        if debug:
            raise
        print(f"slam-gym {words[0]}: {message(error)}", file=sys.stderr)
        return EXIT_ERROR


def help_text() -> str:
    """What `slam-gym --help` prints."""
    width = max(map(len, COMMANDS)) + 2
    return HELP.format(commands="\n".join(f"  {name:<{width}}{line}" for name, (_, line) in COMMANDS.items()))


def message(error: BaseException) -> str:
    """An error for people: an OSError without its number, with the file that it names."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror if error.filename is None else f"{error.strerror}: {str(error.filename)!r}"
    return str(error) or type(error).__name__


def _load(name: str, words: Sequence[str]) -> Any:
    """The command with its options read; tyro prints help and wrong options itself and exits."""
    if name not in COMMANDS:
        import difflib

        near = difflib.get_close_matches(name, COMMANDS, n=1, cutoff=0.5)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise ValueError(f"unknown command.{hint} Commands: {', '.join(COMMANDS)}")
    module, _, attribute = COMMANDS[name][0].partition(":")
    command = getattr(import_module(module), attribute)
    import tyro

    from slam_gym.cli_words import respelled

    config = (tyro.conf.FlagCreatePairsOff,)  # --resume without a --no-resume
    page = inspect.cleandoc(command.__doc__ or COMMANDS[name][1])  # tyro alone would drop the examples
    return tyro.cli(command, prog=f"slam-gym {name}", description=page, args=respelled(command, words), config=config)
