"""``simpick sweep``: grasp success against pose error, from true poses with increasing noise."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import tyro

from simpick.errors import ConfigError
from simpick.experiments.run_config import RunConfig


@dataclass(frozen=True)
class Sweep:
    """Plot grasp success against the error of the poses.

    The same bins are picked with true poses and increasing noise: translation noise alone, then rotation noise alone.
    The same command resumes a sweep that was stopped.
    """

    config: tyro.conf.OmitArgPrefixes[RunConfig] = field(default_factory=lambda: RunConfig(episodes=4))
    """What to run at each level; the sweep sets estimator and noise."""
    levels_mm: tuple[float, ...] = (0.0, 1.0, 2.0, 4.0, 6.0, 8.0, 10.0)
    """Median translation errors, in millimetres."""
    levels_deg: tuple[float, ...] = (0.0, 2.5, 5.0, 10.0, 15.0, 20.0)
    """Median rotation errors, in degrees."""
    out: Path = Path("logs/sweep")
    """Folder for the runs, sweep.csv and sweep.png."""
    overwrite: bool = False
    """Replace results in the folder --out instead of resuming them."""
    workers: int = 1
    """Episodes to run at the same time, each in its own process."""

    def run(self) -> int:
        """Run every step and draw the plot."""
        from rich.console import Console

        from simpick.cli.parts import describe_files
        from simpick.experiments.runs import check_workers
        from simpick.experiments.sweep import NoiseStep, plot_steps, run_step, steps_table, write_csv

        if self.config.perception != "oracle" or self.config.noise_mm or self.config.noise_deg:
            raise ConfigError(
                "a sweep sets perception and noise itself, got --estimator, --noise-mm or --noise-deg; "
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
