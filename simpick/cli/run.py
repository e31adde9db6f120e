"""``simpick run``: pick bins empty with one perception mode; a table of scores, results and recordings."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import tyro

from simpick.cli.outputs import counted, viewer_command
from simpick.experiments.config import Execution, RunConfig


@dataclass(frozen=True)
class Run:
    """Pick bins empty in closed loop and report the scores.

    By default parts are detected in the image and their poses estimated and refined. --estimator oracle knows the true
    poses: an upper bound.

    The same command resumes a run that was stopped, also with more episodes.
    """

    config: tyro.conf.OmitArgPrefixes[RunConfig] = field(default_factory=RunConfig)
    """What to run."""
    out: Path = Path("logs/run")
    """Folder for config.json, results.jsonl and the recordings."""
    execution: tyro.conf.OmitArgPrefixes[Execution] = field(default_factory=Execution)
    """How to run it."""

    def run(self) -> int:
        """Run the missing episodes and print the summary."""
        # First, so that nothing is silent while libraries load.
        from simpick.terminal import Console

        console = Console()
        console.print_line(f"picking {counted(self.config.episodes, 'bin')} with {self.config.mode}: {self.out}")
        from simpick.cli.parts import describe_files
        from simpick.core_time import disturbance_lines
        from simpick.experiments.comparison import Comparison
        from simpick.experiments.report.tables import no_attempts_lines, scores_table

        # First, so that a gripper that can hold none of the parts leaves no folder.
        for line in describe_files(self.config.parts, self.config.gripper):
            console.print_line(line)
        run = Comparison.open(self.config, self.out, overwrite=self.execution.overwrite)
        run.run(self.execution, console)
        console.print(scores_table(self.config, run.results))
        for line in no_attempts_lines({self.config.mode: run.results}):
            console.print_line(line)
        for line in disturbance_lines(run.core_times()):
            console.print_line(line)
        console.print_line(f"results: {self.out / 'results.jsonl'}")
        if self.execution.record:
            files = [run.recording(result) for result in run.results]
            if recorded := [file for file in files if file is not None]:
                console.print_line(f"recordings: open one with: {viewer_command(recorded[0])}")
            if missing := len(files) - len(recorded):
                console.print_line(
                    f"{missing} episodes were run before without --record; --overwrite runs all of them again"
                )
        return 0
