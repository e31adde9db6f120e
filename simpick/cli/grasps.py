"""``simpick grasps``: verify grasps of parts and report how well each gripper covers them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from simpick.config import Config, PositiveInt


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
    grippers: tuple[str, ...] = ("jaw", "suction")
    """Grippers to report."""

    def run(self) -> int:
        """Print the table; parts that are new to the cache take some seconds each."""
        # First, so that nothing is silent while libraries load.
        from simpick.terminal import Console

        console = Console()
        console.print_line(f"grasps of {', '.join(self.parts) or 'the library'} with {', '.join(self.grippers)}")
        from simpick.assets import get_part, library_part_names
        from simpick.grasping import verified_grasps
        from simpick.grasping.coverage import resting_coverage
        from simpick.terminal import narrow_table, track

        columns = [column for gripper in self.grippers for column in (gripper, "covered")]
        title = "verified grasps; share of resting poses with two feasible ones"
        table = narrow_table("part", *columns, title=title)
        names = self.parts or library_part_names()
        for name in track(names, "verifying grasps", console=console):
            part = get_part(name)
            row = [part.name]
            for gripper in self.grippers:
                row += [str(len(verified_grasps(part, gripper))), f"{resting_coverage(part, gripper):.0%}"]
            table.add_row(*row)
        console.print(table)
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
        # First, so that nothing is silent while libraries load.
        from simpick.terminal import Console

        console = Console()
        console.print_line("verifying the grasps of the library with all grippers")
        from simpick.assets import library_part_names
        from simpick.assets.grippers.registry import GRIPPERS
        from simpick.terminal import track
        from simpick.workers import UNLIMITED, WorkerPool

        jobs = [(name, gripper) for name in library_part_names() for gripper in GRIPPERS]
        with WorkerPool(self.workers, UNLIMITED) as pool:
            calls = [pool.submit(_build, job) for job in jobs]
            for call in track(calls, "verifying grasps", console=console):
                console.print(call.result())
        return 0


def _build(job: tuple[str, str]) -> str:
    """Verify and write one part's grasps for one gripper; return a line about it."""
    import time

    from simpick.assets.library import get_part
    from simpick.grasping.part_grasps import candidate_grasps
    from simpick.grasping.store import load_file, save_grasps, shipped_path
    from simpick.grasping.verification import verified

    name, gripper = job
    part, path = get_part(name), shipped_path(name, gripper)
    kept = load_file(path, part, gripper)
    if kept is not None:
        return f"{name} {gripper}: {len(kept)} grasps, kept"
    start = time.perf_counter()
    grasps = verified(part, candidate_grasps(part, gripper), gripper)
    save_grasps(path, part, gripper, grasps)
    return f"{name} {gripper}: {len(grasps)} grasps in {time.perf_counter() - start:.1f} s"
