"""``simpick benchmark``: how fast the simulator is on this machine, and where the time goes."""

from __future__ import annotations

from dataclasses import dataclass, field

import tyro

from simpick.experiments.run_config import RunConfig


@dataclass(frozen=True)
class Benchmark:
    """Pick a bin and report speed against real time, images a second, and time outside MuJoCo.

    With --envs, report episodes an hour of as many environments side by side instead.
    """

    config: tyro.conf.OmitArgPrefixes[RunConfig] = field(default_factory=RunConfig)
    """What to run; each episode is timed."""
    envs: tuple[int, ...] = ()
    """Numbers of vectorised environments to compare, such as 1 2 4; each plays `episodes` episodes or so."""

    def run(self) -> int:
        """Measure and print a table."""
        if self.envs:
            return self._compare_envs()
        from rich.console import Console
        from rich.table import Table

        from simpick.experiments.speed import measure

        figures = measure(self.config)
        table = Table("measure", "value", title=f"{self.config.count} parts, {self.config.gripper}")
        rows = {
            "attempts": f"{figures.attempts}",
            "simulated time": f"{figures.simulated_s:.1f} s",
            "wall-clock time, rendering and planning included": f"{figures.wall_s:.1f} s",
            "times faster than real time": f"{figures.simulated_s / figures.wall_s:.1f}",
            "physics steps a second": f"{figures.steps / figures.wall_s:,.0f}",
            "filling a bin": f"{figures.reset_s:.2f} s",
            "share of time in physics": f"{figures.physics_s / figures.wall_s:.0%}",
            "share of time in rendering": f"{figures.render_s / figures.wall_s:.0%}",
            "share of time outside MuJoCo": f"{1 - (figures.physics_s + figures.render_s) / figures.wall_s:.0%}",
        }
        rows |= {f"{name}": f"{fps:.0f} images/s" for name, fps in figures.images_per_s.items()}
        for name, value in rows.items():
            table.add_row(name, value)
        Console().print(table)
        return 0

    def _compare_envs(self) -> int:
        import os

        from rich.console import Console
        from rich.table import Table

        from simpick.experiments.vector_speed import measure_vector

        config = self.config
        title = f"{config.count} parts, {config.gripper}, {config.perception}, {os.cpu_count()} processor cores"
        columns = ("envs", "episodes", "attempts", "episodes/h", "attempts/h", "time for decisions")
        table = Table(*columns, title=title)
        for column in table.columns:
            column.justify = "right"
        for num_envs in self.envs:
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
