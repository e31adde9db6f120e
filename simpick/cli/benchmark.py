"""``simpick benchmark``: the speed of the simulator on this machine, and where the time is spent."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from simpick.experiments.config import RunConfig


@dataclass(frozen=True)
class Benchmark:
    """Measure the simulator's speed on this machine.

    The table gives speed relative to real time and the share of time outside MuJoCo; control steps and images per
    second beside their limits, what MuJoCo's own calls in the same run would allow alone; and, where they are
    installed, the same of environments of other packages. With --envs it gives episodes per hour of vectorised
    environments instead.
    """

    config: tyro.conf.OmitArgPrefixes[RunConfig] = field(
        default_factory=lambda: RunConfig(estimator="oracle", detections="perfect")
    )
    """What to run, by default without perception; every episode is timed."""
    envs: Annotated[tuple[int, ...], tyro.conf.arg(help_behavior_hint="(default: no vectorised environments)")] = ()
    """Numbers of vectorised environments to compare, such as 1 2 4; each runs about --episodes episodes."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE.json", help_behavior_hint="(default: not written)")] = None
    """File for all figures, with the versions of what was measured."""
    peer_python: Annotated[
        Path | None, tyro.conf.arg(metavar="PYTHON", help_behavior_hint="(default: the one that runs simpick)")
    ] = None
    """Python of the environment in which gymnasium-robotics and robosuite are installed, which need other versions of
    MuJoCo."""

    def run(self) -> int:
        """Measure and print a table."""
        if self.envs:
            return self._compare_envs()
        import json
        import os
        from importlib.metadata import version

        from simpick.caching import atomic_write_text
        from simpick.experiments.peer_speed import measure_peers
        from simpick.experiments.speed import Speed, measure_simulator
        from simpick.terminal import Console, narrow_table, working

        with working("picking, rendering and timing"):
            figures = measure_simulator(self.config)
        with working("timing environments of other packages"):
            peers = measure_peers(self.peer_python)
        rows = {
            "attempts": f"{figures.attempts}",
            "simulated time": f"{figures.simulated_s:.1f} s",
            "wall-clock time, rendering and planning included": f"{figures.wall_s:.1f} s",
            "times faster than real time": f"{figures.simulated_s / figures.wall_s:.1f}",
            "physics steps per second": f"{figures.steps / figures.wall_s:,.0f}",
            "filling a bin": f"{figures.reset_s:.2f} s",
            "share of time in physics": f"{figures.physics_s / figures.wall_s:.0%}",
            "share of time in rendering": f"{figures.render_s / figures.wall_s:.0%}",
            "share of time outside MuJoCo": f"{1 - (figures.physics_s + figures.render_s) / figures.wall_s:.0%}",
        }
        title = f"{self.config.count} parts, {self.config.gripper}"
        console = Console()
        console.print(narrow_table("measure", "value", title=title, rows=rows.items()))
        speeds = {"control steps of BinServo-v0": figures.servo} | {
            f"images, {name}": speed for name, speed in figures.images_per_s.items()
        }
        for peer in peers:
            if peer.per_s is not None and peer.limit_per_s is not None:
                speeds[f"control steps of {peer.environment}, {peer.package}"] = Speed(peer.per_s, peer.limit_per_s)
        limits = [
            (name, f"{speed.per_s:,.0f}", f"{speed.limit_per_s:,.0f}", f"{speed.share:.0%}")
            for name, speed in speeds.items()
        ]
        console.print(
            narrow_table("measure", "per second", "limit", "share", title="MuJoCo's own calls alone", rows=limits)
        )
        for peer in peers:
            if peer.missing is not None:
                console.print_line(f"{peer.environment}, {peer.package}: {peer.missing}")
        if self.out is not None:
            versions = {name: version(name) for name in ("simpick", "mujoco", "gymnasium", "numpy")}
            content = asdict(figures) | {"peers": [asdict(peer) for peer in peers]}
            content |= {"versions": versions, "processor_cores": os.cpu_count()}
            atomic_write_text(self.out, json.dumps(content, indent=2) + "\n")
            console.print_line(f"figures: {self.out}")
        return 0

    def _compare_envs(self) -> int:
        import os

        from simpick.experiments.vector_speed import measure_vector
        from simpick.terminal import Console, narrow_table, working

        config = self.config
        title = f"{config.count} parts, {config.gripper}, {config.estimator}, {os.cpu_count()} processor cores"
        columns = ("envs", "episodes", "attempts", "episodes/h", "attempts/h", "time for decisions")
        table = narrow_table(*columns, title=title, labels=0)
        for num_envs in self.envs:
            with working(f"picking in {num_envs} environments"):
                figures = measure_vector(config, num_envs)
            table.add_row(
                f"{num_envs}",
                f"{figures.episodes}",
                f"{figures.attempts}",
                f"{figures.episodes_per_hour:,.0f}",
                f"{figures.attempts_per_hour:,.0f}",
                f"{figures.decide_s / figures.wall_s:.0%}",
            )
        Console().print(table)
        return 0
