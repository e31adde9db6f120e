"""``simpick run``: pick bins empty with one perception mode; a table of scores, results and recordings."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from simpick.experiments.run_config import RunConfig

if TYPE_CHECKING:
    from rich.table import Table

    from simpick.experiments.result_store import ResultStore


@dataclass(frozen=True)
class Run:
    """Pick bins empty in closed loop and report the scores.

    The same command resumes a run that was stopped, also with more episodes.
    """

    config: tyro.conf.OmitArgPrefixes[RunConfig] = field(default_factory=RunConfig)
    """What to run."""
    out: Path = Path("logs/run")
    """Folder for config.json, results.jsonl and the recordings."""
    record: bool = False
    """Write one rerun recording per episode."""
    overwrite: bool = False
    """Replace results in the folder --out instead of resuming them."""
    workers: int = 1
    """Episodes to run at the same time, each in its own process."""

    def run(self) -> int:
        """Run the missing episodes and print the summary."""
        from rich.console import Console

        from simpick.cli.parts import describe_files
        from simpick.experiments.episodes import recording_file, validate
        from simpick.experiments.provenance import run_identity
        from simpick.experiments.result_store import ResultStore
        from simpick.experiments.runs import check_workers, run_episodes

        check_workers(self.workers)
        validate(self.config)
        store = ResultStore(self.out, run_identity(self.config, [self.config]), overwrite=self.overwrite)
        console = Console()
        for line in describe_files(self.config.parts):
            console.print(line, soft_wrap=True)
        run_episodes(self.config, store, record=self.record, workers=self.workers, console=console)
        console.print(summary_table(self.config, store))
        console.print(f"results: {self.out / 'results.jsonl'}", soft_wrap=True)
        if self.record:
            files = [recording_file(self.out, self.config, result.episode) for result in store.results]
            if recorded := [file for file in files if file.exists()]:
                console.print(f"recordings: open one with: rerun {recorded[0]}", soft_wrap=True)
            if missing := len(files) - len(recorded):
                console.print(
                    f"{missing} episodes were run before without --record; --overwrite runs all of them again",
                    soft_wrap=True,
                )
        return 0


def summary_table(config: RunConfig, store: ResultStore) -> Table:
    """Return the table of grasp scores that ends a run."""
    from rich.table import Table

    from simpick.experiments.analysis.grasp_scores import score_grasps

    scores = score_grasps(store.results)
    # A run with noise is told apart from others by how much of it there is, which the mode's name leaves out.
    noise = f" ({config.noise_deg:g} deg, {config.noise_mm:g} mm)" if config.noise_deg or config.noise_mm else ""
    table = Table(title=f"{config.mode}{noise}, {config.gripper}, {config.detections} detections")
    table.add_column("measure")
    table.add_column("value", justify="right")
    rows = {
        "episodes": f"{scores.episodes}",
        "attempts": f"{scores.attempts}",
        "abstentions": f"{scores.abstentions}",
        "grasp success": f"{scores.grasp_success:.1%}",
        "clearance": f"{scores.clearance:.1%}",
        "bins emptied": f"{scores.cleared_episodes:.1%}",
        "first-try success": f"{scores.first_try_success:.1%}",
        "mean picks per hour": f"{scores.mpph:.0f}",
        "motion per attempt": f"{scores.motion_s:.2f} s",
        "perception per look": f"{scores.perception_s * 1e3:.0f} ms",
        "median rotation error": f"{scores.rotation_deg:.2f} deg",
        "median translation error": f"{scores.translation_mm:.2f} mm",
    }
    rows |= {f"outcome {name}": f"{n}" for name, n in scores.outcomes.items()}
    for name, value in rows.items():
        table.add_row(name, value)
    return table
