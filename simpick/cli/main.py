"""``simpick``: one command line, one file a command.

Only the light parts of simpick are imported here; each command imports what it needs when it runs, so that
``simpick --help`` answers at once.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
from typing import Annotated, Any

import tyro

from simpick.cli.ablate import Ablate
from simpick.cli.benchmark import Benchmark
from simpick.cli.compare import Compare
from simpick.cli.doctor import Doctor
from simpick.cli.evaluate import Evaluate
from simpick.cli.grasps import GraspsCommand
from simpick.cli.parts import PartsCommand
from simpick.cli.pose_benchmark import Yardstick
from simpick.cli.refiner import RefinerCommand
from simpick.cli.run import Run
from simpick.cli.sweep import Sweep
from simpick.cli.templates import TemplatesCommand
from simpick.cli.train import Train
from simpick.errors import SimpickError

DESCRIPTION = "A wind tunnel for robotic bin picking: will this part be picked from RGB, how fast, and why not?"
_configure = tyro.conf.subcommand
Command = (
    Annotated[Run, _configure(name="run")]
    | Annotated[PartsCommand, _configure(name="parts")]
    | Annotated[TemplatesCommand, _configure(name="templates")]
    | Annotated[GraspsCommand, _configure(name="grasps")]
    | Annotated[Evaluate, _configure(name="evaluate")]
    | Annotated[Yardstick, _configure(name="yardstick")]
    | Annotated[Compare, _configure(name="compare")]
    | Annotated[RefinerCommand, _configure(name="refiner")]
    | Annotated[Sweep, _configure(name="sweep")]
    | Annotated[Benchmark, _configure(name="benchmark")]
    | Annotated[Train, _configure(name="train")]
    | Annotated[Ablate, _configure(name="ablate")]
    | Annotated[Doctor, _configure(name="doctor")]
)


def main(arguments: list[str] | None = None) -> int:
    """Run one command and return its exit code; errors that simpick raises on purpose print without a traceback."""
    try:
        command = _parse(arguments)
        if os.environ.get("MUJOCO_GL"):
            import simpick.rendering  # noqa: F401 - refuses an unknown back end before MuJoCo fails on it obscurely
        return command.run()
    except SimpickError as error:
        print(f"simpick: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("simpick: interrupted; what was finished is kept, run the same command again to go on", file=sys.stderr)
        return 130


def _parse(arguments: list[str] | None) -> Any:
    """Return the command that the arguments ask for; exits on what the parser refuses.

    A setting that its own configuration refuses reaches the parser as a ValueError, which it reports under a name of
    its own making. Such an error is complete as it is, and is raised again instead.
    """
    complaint = io.StringIO()
    # One flag each, such as --record (no --no-record, because False is the default), and no --action.out.
    style = (tyro.conf.FlagCreatePairsOff, tyro.conf.OmitArgPrefixes)
    try:
        with contextlib.redirect_stderr(complaint):
            return tyro.cli(Command, prog="simpick", description=DESCRIPTION, args=arguments, config=style)
    except SystemExit as ending:
        refused: BaseException | None = ending
        while refused is not None and not isinstance(refused, SimpickError):
            refused = refused.__context__
        if refused is not None:
            raise refused from None
        sys.stderr.write(complaint.getvalue())
        raise


if __name__ == "__main__":
    sys.exit(main())
