"""Running many episodes: in order or in several processes, resumable, with progress."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from simpick.errors import ConfigError
from simpick.evaluation.episodes import recording_file, run_episode
from simpick.evaluation.result_store import EpisodeResult, ResultStore
from simpick.evaluation.run_config import RunConfig
from simpick.records import PickOutcome, PickRecord


def run_episodes(
    config: RunConfig, store: ResultStore, *, record: bool, workers: int = 1, console: Console | None = None
) -> None:
    """Run the episodes of `config` that `store` does not hold yet, and add each as it ends.

    Raises:
        ConfigError: `workers` is not positive.
    """
    if workers < 1:
        raise ConfigError(f"workers must be 1 or more, got {workers}")
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
            pending = {pool.submit(run_recorded, config, k, store.folder if record else None) for k in missing}
            while pending:
                done, pending = wait(pending, return_when=FIRST_COMPLETED)
                for future in done:
                    finished(future.result())


def run_recorded(config: RunConfig, episode: int, folder: Path | None, on_pick=None) -> EpisodeResult:
    """Run one episode, recorded into `folder` unless that is None."""
    if folder is None:
        return run_episode(config, episode, on_pick=on_pick)
    from simpick.recording import RerunRecorder

    with RerunRecorder(recording_file(folder, config, episode), overwrite=True) as recorder:
        return run_episode(config, episode, recorder=recorder, on_pick=on_pick)
