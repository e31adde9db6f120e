"""A comparison: configuration, folder, episodes and figures. A run is a comparison of one mode."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from simpick.core_time import CoreTime, total
from simpick.experiments.analysis.failure_causes import Failure, find_failures
from simpick.experiments.analysis.paired import PairedStatistics, compare_modes, paired_bins
from simpick.experiments.config import CompareConfig, Execution, RunConfig
from simpick.experiments.episodes import recording_file, validate
from simpick.experiments.modes import ORACLE
from simpick.experiments.provenance import run_provenance
from simpick.experiments.result_store import EpisodeResult, ResultStore
from simpick.experiments.runs import run_jobs
from simpick.terminal import Console

BOOTSTRAP_SEED = 0


@dataclass(frozen=True)
class Comparison:
    """Modes, the bins that they pick, and the results so far."""

    config: RunConfig | CompareConfig
    runs: dict[str, RunConfig]
    """By the mode's full name, in the order asked for."""
    store: ResultStore

    @staticmethod
    def open(config: RunConfig | CompareConfig, folder: Path, *, overwrite: bool = False) -> Comparison:
        """Check everything and open the folder, made if missing.

        Raises:
            SimpickError: a mode, part or setting is wrong, or `folder` holds something else; nothing was run.
        """
        runs = config.runs()
        # The cell is the same for all modes, and `CompareConfig.runs` has checked their estimators.
        validate(next(iter(runs.values())))
        provenance = run_provenance(config, runs.values())
        store = ResultStore(folder, provenance, overwrite=overwrite, config_file=config.CONFIG_FILE)
        return Comparison(config, runs, store)

    @property
    def modes(self) -> tuple[str, ...]:
        """Return the modes' full names."""
        return tuple(self.runs)

    @property
    def results(self) -> tuple[EpisodeResult, ...]:
        """Return the finished episodes that were asked for."""
        return tuple(r for r in self.store.results if r.mode in self.runs)

    def run(self, execution: Execution | None = None, console: Console | None = None) -> None:
        """Run the missing episodes: all modes of one bin, then of the next, so that half a comparison is paired.

        Raises:
            SimpickError: an episode's process died, the disk is full, or the cluster cannot be used; finished episodes
                are kept.
        """
        jobs = [(run, episode) for episode in range(self.config.episodes) for run in self.runs.values()]
        run_jobs(jobs, self.store, execution or Execution(), console)

    def paired(self) -> dict[str, list[EpisodeResult]]:
        """Return each mode's results of the bins that all finished."""
        return paired_bins(self.results, self.modes)

    def statistics(self) -> PairedStatistics:
        """Return figures and paired differences with their intervals, the same each time."""
        return compare_modes(self.results, self.modes, np.random.default_rng(BOOTSTRAP_SEED))

    def failures(self) -> dict[str, list[Failure]]:
        """Return each mode's failures in the paired bins, compared with the oracle's picks if it takes part."""
        paired = self.paired()
        return {mode: find_failures(paired[mode], paired.get(ORACLE, [])) for mode in self.modes}

    def core_times(self) -> dict[str, CoreTime]:
        """Return by mode how long threads ran and waited for a core in the finished episodes."""
        return {mode: total(r.core_time for r in self.results if r.mode == mode) for mode in self.modes}

    def recording(self, result: EpisodeResult) -> Path | None:
        """Return the recording of an episode; None if it was run without."""
        file = recording_file(self.store.path, self.runs[result.mode], result.episode)
        return file if file.exists() else None


def compare(
    config: CompareConfig, folder: Path | str, *, record: bool = False, workers: int = 1, overwrite: bool = False
) -> Comparison:
    """Let perception modes pick the same bins and return the comparison: what ``simpick compare`` does.

    Results are kept in `folder` after each episode; the same call resumes where it was stopped, and may ask for more
    modes or episodes. With `record`, each episode is written there as a rerun recording; `overwrite` replaces results.

    >>> comparison = compare(CompareConfig(modes=("oracle", "refined"), parts=("crane_hook",)), "logs/compare")
    >>> comparison.statistics()  # grasp success, clearance, picks per hour and paired differences, with intervals

    Raises:
        SimpickError: a mode, part or setting is wrong, `folder` holds something else, or a worker process died.
    """
    comparison = Comparison.open(config, Path(folder), overwrite=overwrite)
    comparison.run(Execution(record=record, workers=workers))
    return comparison
