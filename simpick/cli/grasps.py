"""``simpick grasps``: verify grasps of parts and look at how well a gripper covers them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

import tyro

Kind: TypeAlias = Literal["jaw", "suction"]
_KINDS: tuple[Kind, ...] = ("jaw", "suction")


@dataclass(frozen=True)
class GraspsShow:
    """Print how many verified grasps parts have, and in which share of their resting poses they can be picked."""

    parts: tyro.conf.Positional[tuple[str, ...]] = ()
    """Part names or mesh files; none means the library."""
    grippers: tuple[Kind, ...] = _KINDS
    """Which grippers."""

    def run(self) -> int:
        """Print the table; parts that are new to the cache take some seconds each."""
        from rich.console import Console
        from rich.table import Table

        from simpick.assets.library import get_part, library_part_names
        from simpick.grasping import verified_grasps
        from simpick.grasping.coverage import resting_coverage

        table = Table(title="verified grasps; share of resting poses with two feasible ones")
        table.add_column("part")
        for kind in self.grippers:
            table.add_column(kind, justify="right")
            table.add_column("covered", justify="right")
        for name in self.parts or library_part_names():
            part = get_part(name)
            row = [part.name]
            for kind in self.grippers:
                row += [str(len(verified_grasps(part, kind))), f"{resting_coverage(part, kind):.0%}"]
            table.add_row(*row)
        Console().print(table)
        return 0


@dataclass(frozen=True)
class GraspsBuild:
    """Verify the library's grasps and write them into the source tree, where they ship with the package.

    Run it after a change to library parts, grippers, sampling or verification. Files that still fit are kept.
    """

    workers: int = 1
    """Parts to work on at the same time, each in a process of its own."""

    def run(self) -> int:
        """Write ``assets/grasps/*.npz``."""
        from concurrent.futures import ProcessPoolExecutor
        from multiprocessing import get_context

        from rich.console import Console

        from simpick.assets.library import library_part_names
        from simpick.errors import ConfigError

        if self.workers < 1:
            raise ConfigError(f"workers must be 1 or more, got {self.workers}")
        console = Console()
        jobs: list[tuple[str, Kind]] = [(name, kind) for name in library_part_names() for kind in _KINDS]
        with ProcessPoolExecutor(self.workers, mp_context=get_context("spawn")) as pool:
            for line in pool.map(_build, jobs):
                console.print(line)
        return 0


def _build(job: tuple[str, Kind]) -> str:
    """Verify and write one part's grasps for one gripper; return a line about it."""
    import time

    from simpick.assets.library import get_part
    from simpick.grasping.part_grasps import candidate_grasps
    from simpick.grasping.store import load_file, save_grasps, shipped_path
    from simpick.grasping.verification import verified

    name, kind = job
    part, path = get_part(name), shipped_path(name, kind)
    kept = load_file(path, part, kind)
    if kept is not None:
        return f"{name} {kind}: {len(kept)} grasps, kept"
    start = time.perf_counter()
    grasps = verified(part, candidate_grasps(part, kind))
    save_grasps(path, part, kind, grasps)
    return f"{name} {kind}: {len(grasps)} grasps in {time.perf_counter() - start:.1f} s"


@dataclass(frozen=True)
class GraspsCommand:
    """Verify grasps of parts, and see how well the grippers cover them."""

    action: (
        Annotated[GraspsShow, tyro.conf.subcommand(name="show", prefix_name=False)]
        | Annotated[GraspsBuild, tyro.conf.subcommand(name="build", prefix_name=False)]
    )

    def run(self) -> int:
        """Run the chosen subcommand."""
        return self.action.run()
