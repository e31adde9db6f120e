"""Running many episodes: in order, in several processes or on a cluster; resumable, with progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from simpick.errors import ConfigError, SimpickError
from simpick.experiments.episodes import recording_file, run_configured_episode
from simpick.experiments.result_store import EpisodeResult, ResultStore
from simpick.experiments.run_config import RunConfig
from simpick.records import PickOutcome, PickRecord
from simpick.workers import UNLIMITED, LostCallError, WorkerPool


@dataclass(frozen=True)
class Job:
    """One episode to run."""

    config: RunConfig
    episode: int

    @property
    def key(self) -> tuple[int, str]:
        """Return the key of the result that this job makes."""
        return self.episode, self.config.mode


def run_episodes(
    config: RunConfig, store: ResultStore, *, record: bool, workers: int = 1, console: Console | None = None
) -> None:
    """Run the episodes of `config` that `store` does not hold yet, and add each as it ends.

    Raises:
        SimpickError: a worker process was killed.
        OutputError: the disk is full.
    """
    jobs = [Job(config, episode) for episode in range(config.episodes)]
    run_jobs(jobs, store, record=record, workers=workers, console=console)


def run_jobs(
    jobs: Sequence[Job],
    store: ResultStore,
    *,
    record: bool,
    workers: int = 1,
    ray_address: str | None = None,
    console: Console | None = None,
) -> None:
    """Run the jobs that `store` has no results of yet, begun in their order, and add each result as it comes.

    Raises:
        SimpickError: a worker process was killed, or the Ray cluster at `ray_address` cannot be used.
        OutputError: the disk is full.
    """
    missing = [job for job in jobs if job.key not in store]
    folder = store.path if record else None
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console) as progress:
        task = progress.add_task("episodes", total=len(jobs), completed=len(jobs) - len(missing))

        def picked(job: Job, pick: PickRecord) -> None:
            where = f"bin {job.episode}, {job.config.mode}, pick {pick.pick}"
            progress.update(task, description=f"{where}: {pick.outcome.value}, {pick.remaining} left")

        for result in _results(missing, folder, workers, ray_address, picked):
            store.add(result)
            progress.advance(task)
            if result.ended == PickOutcome.SIMULATION_FAULT:
                progress.console.print(
                    f"episode {result.episode} of {result.mode}: simulation fault: {result.picks[-1].cause}"
                )


def check_workers(workers: int) -> None:
    """Raise `ConfigError` unless there is at least one worker."""
    if workers < 1:
        raise ConfigError(f"workers must be 1 or more, got {workers}")


def run_recorded(
    config: RunConfig, episode: int, folder: Path | None, on_pick: Callable[[PickRecord], None] | None = None
) -> EpisodeResult:
    """Run one episode, recorded into `folder` unless that is None."""
    if folder is None:
        return run_configured_episode(config, episode, on_pick=on_pick)
    from simpick.recording import RerunRecorder

    with RerunRecorder(recording_file(folder, config, episode), overwrite=True) as recorder:
        return run_configured_episode(config, episode, recorder=recorder, on_pick=on_pick)


def _results(
    jobs: Sequence[Job],
    folder: Path | None,
    workers: int,
    ray_address: str | None,
    on_pick: Callable[[Job, PickRecord], None],
) -> Iterator[EpisodeResult]:
    """Yield the results of these jobs as they end."""
    if not jobs:
        return
    if ray_address is not None:
        # Only here, because Ray is an extra that few have.
        from simpick.experiments.ray_runs import results_from_ray

        yield from results_from_ray([(job.config, job.episode) for job in jobs], folder, ray_address)
    elif workers == 1:
        for job in jobs:
            yield run_recorded(job.config, job.episode, folder, lambda pick, job=job: on_pick(job, pick))
    else:
        yield from _results_from_pool(jobs, folder, workers)


def _results_from_pool(jobs: Sequence[Job], folder: Path | None, workers: int) -> Iterator[EpisodeResult]:
    with WorkerPool(workers, UNLIMITED) as pool:
        episodes = {pool.submit(run_recorded, job.config, job.episode, folder): job for job in jobs}
        for future in as_completed(episodes):
            try:
                yield future.result()
            except LostCallError as error:
                job = episodes[future]
                raise SimpickError(
                    f"episode {job.episode} of {job.config.mode} was lost, perhaps because memory ran out: {error}. "
                    "What was finished is kept: run the same command again, with fewer --workers"
                ) from error
