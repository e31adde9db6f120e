"""Running many episodes: in order or in several processes, resumable, with progress."""

from __future__ import annotations

import itertools
import multiprocessing
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from simpick.errors import ConfigError, SimpickError
from simpick.evaluation.episodes import recording_file, run_episode
from simpick.evaluation.result_store import EpisodeResult, ResultStore
from simpick.evaluation.run_config import RunConfig
from simpick.records import PickOutcome, PickRecord


def run_episodes(
    config: RunConfig, store: ResultStore, *, record: bool, workers: int = 1, console: Console | None = None
) -> None:
    """Run the episodes of `config` that `store` does not hold yet, and add each as it ends.

    Raises:
        SimpickError: a worker process was killed.
    """
    missing = [episode for episode in range(config.episodes) if episode not in store]
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console) as progress:
        task = progress.add_task("episodes", total=config.episodes, completed=config.episodes - len(missing))

        def finished(result: EpisodeResult) -> None:
            store.add(result)
            progress.advance(task)
            if result.ended == PickOutcome.SIMULATION_FAULT:
                progress.console.print(f"episode {result.episode}: simulation fault: {result.picks[-1].cause}")

        def picked(pick: PickRecord) -> None:
            progress.update(task, description=f"pick {pick.pick}: {pick.outcome.value}, {pick.remaining} left")

        if workers == 1:
            for episode in missing:
                finished(run_recorded(config, episode, store.folder if record else None, picked))
            return
        # Spawned, because a forked child would share its parent's OpenGL context.
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(workers, mp_context=context) as pool:
            # Never more episodes than workers: the pool runs what it was given to the end, even when interrupted.
            waiting, pending = iter(missing), set()
            try:
                while True:
                    for episode in itertools.islice(waiting, workers - len(pending)):
                        pending.add(pool.submit(run_recorded, config, episode, store.folder if record else None))
                    if not pending:
                        return
                    done, pending = wait(pending, return_when=FIRST_COMPLETED)
                    for future in done:
                        finished(future.result())
            except BrokenProcessPool as error:
                raise SimpickError(
                    "a worker process was killed, perhaps because memory ran out. What was finished is kept: "
                    "run the same command again, with fewer --workers"
                ) from error


def check_workers(workers: int) -> None:
    """Raise `ConfigError` unless there is at least one worker."""
    if workers < 1:
        raise ConfigError(f"workers must be 1 or more, got {workers}")


def run_recorded(config: RunConfig, episode: int, folder: Path | None, on_pick=None) -> EpisodeResult:
    """Run one episode, recorded into `folder` unless that is None."""
    if folder is None:
        return run_episode(config, episode, on_pick=on_pick)
    from simpick.recording import RerunRecorder

    with RerunRecorder(recording_file(folder, config, episode), overwrite=True) as recorder:
        return run_episode(config, episode, recorder=recorder, on_pick=on_pick)
