"""``simpick sweep``: how exact must a pose be? Oracle poses with more and more noise, and a plot of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import tyro

from simpick.errors import ConfigError
from simpick.experiments.run_config import RunConfig


@dataclass(frozen=True)
class Sweep:
    """Blur the oracle's poses step by step, run the same bins at each step, and plot grasp success.

    Translation noise is swept without rotation noise and the other way round. Each step is a run of its own under
    `out`, so that a sweep which was stopped goes on where it was.
    """

    config: tyro.conf.OmitArgPrefixes[RunConfig] = field(default_factory=lambda: RunConfig(episodes=4))
    """What to run at each step; perception and noise are set by the sweep."""
    levels_mm: tuple[float, ...] = (0.0, 1.0, 2.0, 4.0, 6.0, 8.0, 10.0)
    """Median translation errors to run."""
    levels_deg: tuple[float, ...] = (0.0, 2.5, 5.0, 10.0, 15.0, 20.0)
    """Median rotation errors to run."""
    out: Path = Path("logs/sweep")
    """Folder for the runs, sweep.csv and sweep.png."""
    overwrite: bool = False
    """Replace results that are in `out` already, instead of going on with them."""
    workers: int = 1
    """Episodes to run at the same time, each in a process of its own."""

    def run(self) -> int:
        """Run every step and draw the plot."""
        from rich.console import Console

        from simpick.cli.parts import describe_files
        from simpick.experiments.runs import check_workers
        from simpick.experiments.sweep import NoiseStep, plot_steps, run_step, steps_table, write_csv

        if self.config.perception != "oracle" or self.config.noise_mm or self.config.noise_deg:
            raise ConfigError(
                "a sweep sets perception and noise itself, got --perception, --noise-mm or --noise-deg; "
                "choose the levels with --levels-mm and --levels-deg"
            )
        if min((*self.levels_mm, *self.levels_deg), default=0.0) < 0:
            raise ConfigError(
                f"levels_mm and levels_deg must be zero or more, got {self.levels_mm} and {self.levels_deg}"
            )
        check_workers(self.workers)
        console = Console()
        for line in describe_files(self.config.parts):
            console.print(line, soft_wrap=True)
        steps: list[NoiseStep] = []
        levels = [("mm", value) for value in self.levels_mm] + [("deg", value) for value in self.levels_deg]
        for unit, value in levels:
            console.print(f"noise: median {value:g} {unit}")
            steps.append(run_step(self.config, unit, value, self.out, self.overwrite, self.workers, console))
        console.print(steps_table(steps))
        write_csv(steps, self.out / "sweep.csv")
        plot_steps(steps, self.out / "sweep.png")
        console.print(f"plot: {self.out / 'sweep.png'}")
        return 0
