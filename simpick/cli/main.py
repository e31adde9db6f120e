"""``simpick``: one command line, one file per command.

A command is a frozen dataclass whose fields are its options, read by tyro, and whose method `run` does the work and
returns the exit code. `COMMANDS` lists them. Only the chosen command's module is imported, so that ``simpick --help``
answers at once.
"""

from __future__ import annotations

import ast
import contextlib
import io
import itertools
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Protocol, runtime_checkable

from simpick import __version__
from simpick.errors import SimpickError, UnknownNameError
from simpick.threads import configure_threads

DESCRIPTION = "A wind tunnel for robotic bin picking: will this part be picked from RGB, how fast, and why not?"
COMMANDS = {
    "run": "run:Run",
    "compare": "compare:Compare",
    "sweep": "sweep:Sweep",
    "estimate": "estimate:Estimate",
    "evaluate": "evaluate:Evaluate",
    "pose-benchmark": "pose_benchmark:PoseBenchmark",
    "detector-benchmark": "detector_benchmark:DetectorBenchmark",
    "parts list": "parts:PartsList",
    "parts show": "parts:PartsShow",
    "parts check": "part_check:PartsCheck",
    "parts add": "parts:PartsAdd",
    "parts remove": "parts:PartsRemove",
    "parts onboard": "parts:PartsOnboard",
    "templates show": "templates:TemplatesShow",
    "templates make": "templates:TemplatesMake",
    "grasps show": "grasps:GraspsShow",
    "grasps build": "grasps:GraspsBuild",
    "train": "train:Train",
    "train detector": "train_detector:TrainDetector",
    "ablate": "ablate:Ablate",
    "refiner basin": "refiner:RefinerBasin",
    "refiner calibrate": "refiner:RefinerCalibrate",
    "detector-calibrate": "detector_calibrate:DetectorCalibrate",
    "benchmark": "benchmark:Benchmark",
    "soak": "soak:Soak",
    "doctor": "doctor:Doctor",
}
"""Module and class in `simpick.cli` of each command, in the order of the help."""
FORMER_COMMANDS = {"yardstick": "pose-benchmark"}
FORMER_OPTIONS = {
    "run": {"--perception": "--estimator"},
    "benchmark": {"--perception": "--estimator"},
    "evaluate": {"--scenes": "--bins", "--noise": "--detections"},
    "pose-benchmark": {"--noise": "--detections", "--steps": "--decoder"},
    "parts add": {"--replace": "--overwrite"},
    "train": {
        **{f"--{name}": f"--training.{name}" for name in ("batch", "parts", "templates", "learning-rate", "schedule")},
        **{f"--validation-{name}": f"--training.validation-{name}" for name in ("shards", "queries")},
        **{f"--no-{name}": f"--network.no-{name}" for name in ("relative-pose", "multiview", "template-pose")},
        **{f"--no-{name}": f"--network.no-{name}" for name in ("matching", "flow")},
        **{f"--{name}": f"--network.{name}" for name in ("template-views", "spread-deg", "spread-m")},
    },
}
"""Former names of commands and of their options, which still work in version 0.2."""


@runtime_checkable
class Command(Protocol):
    """What a command must offer."""

    def run(self) -> int:
        """Do the work and return the exit code."""
        ...


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; errors that simpick raises on purpose print without a traceback."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    configure_threads()
    try:
        if arguments == ["--version"]:
            print(f"simpick {__version__}")
            return 0
        name = _command_name(arguments)
        if name not in COMMANDS:
            print(_overview(name))
            return 0 if {"-h", "--help"} & set(arguments) else 2
        command = _parse(name, _current_options(name, arguments[len(name.split()) :]))
        if os.environ.get("MUJOCO_GL"):
            import simpick.rendering  # noqa: F401 - rejects an unknown back end before MuJoCo fails on it obscurely
        # Only here, because --help needs neither.
        from simpick.terminal import breaking_silence

        with breaking_silence(name):
            return command.run()
    except SimpickError as error:
        print(f"simpick: {error}", file=sys.stderr)
        return 2
    except ModuleNotFoundError as error:
        if error.name != "mujoco":
            raise
        text = f"this command needs MuJoCo, which cannot be imported here ({error}): pip install mujoco"
        print(f"simpick: {text}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("simpick: interrupted; finished work is kept, run the same command again to resume", file=sys.stderr)
        return 130


def _command_name(arguments: Sequence[str]) -> str:
    """Return the command that the arguments begin with, or the group whose overview they ask for: "" for all.

    Raises:
        UnknownNameError: there is no such command.
    """
    words = list(itertools.takewhile(lambda word: not word.startswith("-"), arguments[:2]))
    if words:
        words[0] = _current(words[0], FORMER_COMMANDS)
    for name in (" ".join(words), *words[:1]):
        if name in COMMANDS:
            return name
    groups = {name.split()[0] for name in COMMANDS if " " in name}
    if not words or (words[0] in groups and len(words) == 1):
        return "".join(words)
    raise UnknownNameError("command", " ".join(words if words[0] in groups else words[:1]), COMMANDS)


def _current_options(name: str, arguments: Sequence[str]) -> list[str]:
    """Return the arguments with former names of options replaced."""
    former = FORMER_OPTIONS.get(name, {})
    split = [argument.partition("=") for argument in arguments]
    return [_current(option, former) + sign + value for option, sign, value in split]


def _current(word: str, former: Mapping[str, str]) -> str:
    if word in former:
        print(f"simpick: {word} is now called {former[word]}", file=sys.stderr)
    return former.get(word, word)


def _overview(group: str) -> str:
    """Return one line per command, of all commands or of those of a group."""
    names = [name for name in COMMANDS if not group or name.split()[0] == group]
    width = max(map(len, names))
    lines = [f"  {name:{width}}  {_summary(name)}" for name in names]
    usage = f"usage: simpick {group} COMMAND [OPTIONS]".replace("  ", " ")
    more = "simpick COMMAND --help shows the options of a command, simpick --version the version."
    return "\n".join([usage, "", *textwrap.wrap(DESCRIPTION, 80), "", *lines, "", *textwrap.wrap(more, 80)])


def _summary(name: str) -> str:
    """Return the first line of a command's docstring, read without importing the command."""
    module, _, cls = COMMANDS[name].partition(":")
    source = ast.parse(Path(__file__).with_name(f"{module}.py").read_text())
    (node,) = (node for node in source.body if isinstance(node, ast.ClassDef) and node.name == cls)
    return (ast.get_docstring(node) or "").splitlines()[0]


def _load(name: str) -> type[Command]:
    module, _, cls = COMMANDS[name].partition(":")
    return getattr(import_module(f"simpick.cli.{module}"), cls)


def _parse(name: str, arguments: Sequence[str]) -> Command:
    """Return the command with its options; exits where tyro rejects them, and after printing help.

    A value that its own configuration rejects reaches tyro as a ValueError, which it reports as an error of its own.
    Such an error is complete, and is raised again instead.
    """
    import tyro

    shown, complaint = _Captured(), io.StringIO()
    command = _load(name)
    # A command with `defaults` has options that set the defaults of others, such as the size of a network.
    defaults = getattr(command, "defaults", None)
    default = defaults(arguments) if defaults else tyro.MISSING_NONPROP
    # One flag per switch, such as --record: no --no-record, because False is the default. Where defaults are set by
    # options, a switch can be on by default, and has both flags.
    style = () if defaults else (tyro.conf.FlagCreatePairsOff,)
    try:
        with contextlib.redirect_stdout(shown), contextlib.redirect_stderr(complaint):
            return tyro.cli(command, default=default, prog=f"simpick {name}", args=arguments, config=style)
    except SystemExit as ending:
        rejected: BaseException | None = ending
        while rejected is not None and not isinstance(rejected, SimpickError):
            rejected = rejected.__context__
        if rejected is not None:
            raise rejected from None
        sys.stdout.write(_wrapped(shown.getvalue()))
        sys.stderr.write(complaint.getvalue())
        raise


class _Captured(io.StringIO):
    """Text on its way to the standard output, formatted by tyro for that."""

    encoding = property(lambda self: sys.__stdout__.encoding if sys.__stdout__ else None)  # type: ignore[assignment]

    def isatty(self) -> bool:
        return sys.__stdout__ is not None and sys.__stdout__.isatty()


def _wrapped(text: str) -> str:
    """Return help with its long lines wrapped to the terminal: the command's description, which tyro does not wrap."""
    width = shutil.get_terminal_size().columns
    lines = []
    for line in re.sub("\n{3,}", "\n\n", text).split("\n"):
        visible = re.sub(r"\x1b\[[0-9;]*m", "", line)
        lines += textwrap.wrap(line, width) if len(visible) > width else [line]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
