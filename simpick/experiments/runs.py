"""Running many episodes: in order, in several processes or on a cluster; resumable, with progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from pathlib import Path

from simpick.errors import SimpickError
from simpick.experiments.config import Execution, RunConfig
from simpick.experiments.episodes import run_recorded_episode
from simpick.experiments.ray_runs import results_from_ray
from simpick.experiments.result_store import EpisodeResult, ResultStore
from simpick.records import PickOutcome, PickRecord
from simpick.terminal import Console, progress_bar
from simpick.workers import UNLIMITED, LostCallError, WorkerPool

Job = tuple[RunConfig, int]
"""The mode that picks, and the number of the episode."""


def run_jobs(jobs: Sequence[Job], store: ResultStore, execution: Execution, console: Console | None = None) -> None:
    """Run the jobs that `store` has no results of yet, started in their order, and add each result as it arrives.

    Raises:
        SimpickError: an episode's process died, or the Ray cluster cannot be used.
        OutputError: the disk is full.
    """
    missing = [(config, episode) for config, episode in jobs if (episode, config.mode) not in store]
    with progress_bar(console, keep=True) as progress:
        task = progress.add_task("episodes", total=len(jobs), completed=len(jobs) - len(missing))

        def begin(config: RunConfig, episode: int) -> None:
            progress.update(task, description=f"bin {episode}, {config.mode}: filling it, loading estimators")

        def show(config: RunConfig, episode: int, pick: PickRecord) -> None:
            where = f"bin {episode}, {config.mode}, pick {pick.pick}"
            progress.update(task, description=f"{where}: {pick.outcome.value}, {pick.remaining} left")

        for result in _results(missing, store.path if execution.record else None, execution, begin, show):
            store.add(result)
            progress.advance(task)
            if result.ended == PickOutcome.SIMULATION_FAULT:
                progress.console.print(
                    f"episode {result.episode} of {result.mode}: simulation fault: {result.picks[-1].cause}"
                )


def _results(
    jobs: Sequence[Job],
    folder: Path | None,
    execution: Execution,
    on_start: Callable[[RunConfig, int], None],
    on_pick: Callable[[RunConfig, int, PickRecord], None],
) -> Iterator[EpisodeResult]:
    """Yield the results of these jobs as they end; recordings go into `folder` unless that is None."""
    if not jobs:
        return
    if execution.ray is not None:
        yield from results_from_ray(jobs, folder, execution.ray)
    elif execution.workers > 1:
        yield from _results_from_pool(jobs, folder, execution.workers)
    else:
        for job in jobs:
            on_start(*job)
            yield run_recorded_episode(*job, folder, on_pick=lambda pick, job=job: on_pick(*job, pick))


def _results_from_pool(jobs: Sequence[Job], folder: Path | None, workers: int) -> Iterator[EpisodeResult]:
    with WorkerPool(workers, UNLIMITED) as pool:
        job_of = {pool.submit(run_recorded_episode, *job, folder): job for job in jobs}
        for future in as_completed(job_of):
            try:
                yield future.result()
            except LostCallError as error:
                config, episode = job_of[future]
                raise SimpickError(
                    f"episode {episode} of {config.mode} was lost, perhaps because memory ran out: {error}. "
                    "What was finished is kept: run the same command again, with fewer --workers"
                ) from error
