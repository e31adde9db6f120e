"""``simpick grasps``: verify grasps of parts and report how well each gripper covers them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

import tyro

from simpick.config import Config, PositiveInt

Kind: TypeAlias = Literal["jaw", "suction"]
_KINDS: tuple[Kind, ...] = ("jaw", "suction")


@dataclass(frozen=True)
class GraspsShow:
    """Count the verified grasps of parts, per gripper.

    The table also gives the share of a part's resting poses in which it can be picked.
    """

    parts: Annotated[
        tuple[str, ...],
        tyro.conf.Positional,
        tyro.conf.arg(metavar="PART ...", help_behavior_hint="(default: the library)"),
    ] = ()
    """Part names or paths to mesh files."""
    grippers: tuple[Kind, ...] = _KINDS
    """Grippers to report."""

    def run(self) -> int:
        """Print the table; parts that are new to the cache take some seconds each."""
        from simpick.assets.library import get_part, library_part_names
        from simpick.grasping import verified_grasps
        from simpick.grasping.coverage import resting_coverage
        from simpick.terminal import Console, narrow_table

        columns = [column for kind in self.grippers for column in (kind, "covered")]
        title = "verified grasps; share of resting poses with two feasible ones"
        table = narrow_table("part", *columns, title=title)
        for name in self.parts or library_part_names():
            part = get_part(name)
            row = [part.name]
            for kind in self.grippers:
                row += [str(len(verified_grasps(part, kind))), f"{resting_coverage(part, kind):.0%}"]
            table.add_row(*row)
        Console().print(table)
        return 0


@dataclass(frozen=True)
class GraspsBuild(Config):
    """Verify the library's grasps and write the files that ship.

    Run it after a change to library parts, grippers, sampling or verification. Files that still fit are kept.
    """

    workers: PositiveInt = 1
    """Parts to process at the same time, each in its own process."""

    def run(self) -> int:
        """Write ``assets/grasps/*.npz``."""
        from simpick.assets.library import library_part_names
        from simpick.terminal import Console
        from simpick.workers import UNLIMITED, WorkerPool

        console = Console()
        jobs: list[tuple[str, Kind]] = [(name, kind) for name in library_part_names() for kind in _KINDS]
        with WorkerPool(self.workers, UNLIMITED) as pool:
            for call in [pool.submit(_build, job) for job in jobs]:
                console.print(call.result())
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
