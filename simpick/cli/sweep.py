"""``simpick sweep``: grasp success against pose error, from true poses with increasing noise."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import tyro

from simpick.cli.outputs import counted
from simpick.experiments.config import Execution, SweepConfig


@dataclass(frozen=True)
class Sweep:
    """Plot grasp success against the error of the poses.

    The same bins are picked with true poses and increasing noise: translation noise alone, then rotation noise alone.
    Each level is a mode of a comparison, such as oracle_noise@2mm. The same command resumes a sweep that was stopped.
    """

    config: tyro.conf.OmitArgPrefixes[SweepConfig] = field(default_factory=SweepConfig)
    """What to run."""
    out: Path = Path("logs/sweep")
    """Folder for compare.json, results.jsonl, sweep.csv and sweep.png."""
    execution: tyro.conf.OmitArgPrefixes[Execution] = field(default_factory=Execution)
    """How to run it."""

    def run(self) -> int:
        """Run every level and draw the plot."""
        # First, so that nothing is silent while libraries load.
        from simpick.terminal import Console

        console = Console()
        console.print_line(
            f"picking {counted(self.config.episodes, 'bin')} at {len(self.config.steps())} levels of noise: {self.out}"
        )
        from simpick.cli.parts import describe_files
        from simpick.experiments.comparison import Comparison
        from simpick.experiments.report.tables import no_attempts_lines
        from simpick.experiments.sweep import noise_steps, plot_steps, steps_csv, steps_table

        # First, so that a gripper that can hold none of the parts leaves no folder.
        for line in describe_files(self.config.parts, self.config.gripper):
            console.print_line(line)
        comparison = Comparison.open(self.config.comparison(), self.out, overwrite=self.execution.overwrite)
        comparison.run(self.execution, console)
        steps = noise_steps(self.config, comparison)
        console.print(steps_table(steps))
        by_mode = {mode: [r for r in comparison.results if r.mode == mode] for mode in comparison.modes}
        for line in no_attempts_lines(by_mode):
            console.print_line(line)
        comparison.store.write("sweep.csv", steps_csv(steps))
        plot_steps(steps, self.out / "sweep.png")
        console.print_line(f"plot: {self.out / 'sweep.png'}")
        return 0
