"""``simpick compare``: perception modes compared on the same bins: success, speed and causes of failure."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import tyro

from simpick.experiments.config import CompareConfig, Execution


@dataclass(frozen=True)
class Compare:
    """Compare perception modes that pick the same bins.

    Modes are oracle (true poses), oracle_noise (true poses with noise), retrieval, retrieval_refined, coarse, fine,
    refined, and estimators of other packages. NAME@K asks an estimator for K hypotheses per part. NAME+closer corrects
    each grasp by a second image, from the wrist camera. oracle_noise@2mm and oracle_noise@5deg set the noise in the
    name. Each mode is compared with the first and with its predecessor.

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
        from simpick.cli.parts import describe_files
        from simpick.errors import OutputError, SimpickError
        from simpick.experiments.comparison import Comparison
        from simpick.experiments.report.html import write_report
        from simpick.experiments.report.tables import causes_table, differences_tables, modes_tables
        from simpick.terminal import Console

        comparison = Comparison.open(self.config, self.out, overwrite=self.execution.overwrite)
        console = Console()
        for line in describe_files(self.config.parts, self.config.gripper):
            console.print_line(line)
        try:
            comparison.run(self.execution, console)
        except (SimpickError, KeyboardInterrupt):
            # What stopped the run must be reported, also where the report cannot be written either.
            with suppress(OutputError):
                if comparison.statistics().bins:
                    console.print_line(f"partial report: {write_report(comparison)}")
            raise
        statistics = comparison.statistics()
        causes = causes_table(comparison.failures())
        for table in (*modes_tables(statistics), *differences_tables(statistics), causes):
            console.print(table)
        console.print_line(f"report: {write_report(comparison)}")
        return 0
