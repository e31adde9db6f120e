"""``simpick compare``: perception modes compared on the same bins: success, speed and causes of failure."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import tyro

from simpick.cli.outputs import counted, viewer_command
from simpick.experiments.config import CompareConfig, Execution


@dataclass(frozen=True)
class Compare:
    """Compare perception modes that pick the same bins.

    Modes are retrieval, retrieval_refined, coarse, fine, refined and estimators of other packages; and, as upper
    bounds, oracle (true poses) and oracle_noise (true poses with noise). NAME@K asks an estimator for K hypotheses per
    part. NAME+closer corrects each grasp by a second image, from the wrist camera. oracle_noise@2mm and
    oracle_noise@5deg set the noise in the name. Each mode is compared with the first and with its predecessor.

    The same command resumes a comparison that was stopped, also with more episodes or more modes.
    """

    config: tyro.conf.OmitArgPrefixes[CompareConfig] = field(default_factory=CompareConfig)
    """What to compare."""
    out: Path = Path("logs/compare")
    """Folder for compare.json, results.jsonl, report.html, the plots and the recordings."""
    execution: tyro.conf.OmitArgPrefixes[Execution] = field(default_factory=Execution)
    """How to run it."""

    def run(self) -> int:
        """Run what is missing, print the tables and write the report, also of a run that stops half-way."""
        # First, so that nothing is silent while libraries load.
        from simpick.terminal import Console, working

        console = Console()
        console.print_line(
            f"comparing {', '.join(self.config.modes)} on {counted(self.config.episodes, 'bin')}: {self.out}"
        )
        from simpick.cli.parts import describe_files
        from simpick.core_time import disturbance_lines
        from simpick.errors import OutputError, SimpickError
        from simpick.experiments.comparison import Comparison
        from simpick.experiments.report.html import write_report
        from simpick.experiments.report.tables import (
            causes_table,
            differences_tables,
            modes_tables,
            no_attempts_lines,
            one_bin_table,
            source_line,
        )

        # First, so that a gripper that can hold none of the parts leaves no folder.
        for line in describe_files(self.config.parts, self.config.gripper):
            console.print_line(line)
        comparison = Comparison.open(self.config, self.out, overwrite=self.execution.overwrite)
        try:
            comparison.run(self.execution, console)
        except (SimpickError, KeyboardInterrupt):
            # What stopped the run must be reported, also where the report cannot be written either.
            with suppress(OutputError):
                if comparison.statistics().bins:
                    console.print_line(f"partial report: {write_report(comparison)}")
            raise
        with working("computing intervals", console):
            statistics = comparison.statistics()
        causes = causes_table(comparison.failures())
        console.print_line(source_line(self.config.detections, comparison.modes))
        tables = [one_bin_table(statistics)]
        if len(statistics.bins) != 1:
            tables = [*modes_tables(statistics), *differences_tables(statistics)]
        for table in (*tables, causes):
            console.print(table)
        by_mode = {mode: [r for r in comparison.results if r.mode == mode] for mode in comparison.modes}
        for line in no_attempts_lines(by_mode):
            console.print_line(line)
        for line in disturbance_lines(comparison.core_times()):
            console.print_line(line)
        with working("writing the report", console):
            report = write_report(comparison)
        console.print_line(f"report: {report}")
        last = [comparison.recording(result) for result in comparison.results if result.mode == comparison.modes[-1]]
        if recorded := [file for file in last if file is not None]:
            console.print_line(f"recordings: open one of {comparison.modes[-1]} with: {viewer_command(recorded[0])}")
        return 0
