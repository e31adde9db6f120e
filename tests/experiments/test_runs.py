"""Several workers: each episode is run once, and what stops a run is explained."""

from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import pytest

from simpick.errors import SimpickError
from simpick.experiments import runs
from simpick.experiments.config import Execution, RunConfig
from simpick.experiments.result_store import EpisodeResult, ResultStore
from simpick.workers import LostCallError, WorkerLimits

CONFIG = RunConfig(episodes=8, estimator="oracle")
JOBS = [(CONFIG, episode) for episode in range(CONFIG.episodes)]


class Threads(ThreadPoolExecutor):
    """A pool of threads, which start at once."""

    def __init__(self, workers: int, limits: WorkerLimits) -> None:
        super().__init__(workers)


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ResultStore:
    """An empty store; workers are threads."""
    monkeypatch.setattr(runs, "WorkerPool", Threads)
    return ResultStore(tmp_path / "run", CONFIG.to_json())


def test_all_episodes_are_run_once(store: ResultStore, monkeypatch: pytest.MonkeyPatch) -> None:
    store.add(EpisodeResult(3, 3, (), (), "cleared", mode="oracle"))
    run: list[int] = []

    def episode(config: RunConfig, number: int, folder: Path | None) -> EpisodeResult:
        run.append(number)
        return EpisodeResult(number, number, (), (), "cleared", mode="oracle")

    monkeypatch.setattr(runs, "run_recorded_episode", episode)
    runs.run_jobs(JOBS, store, Execution(workers=3))
    assert sorted(run) == [0, 1, 2, 4, 5, 6, 7]
    assert [result.episode for result in store.results] == list(range(8))


def test_an_interrupt_closes_the_pool(store: ResultStore, monkeypatch: pytest.MonkeyPatch) -> None:
    closed: list[bool] = []

    class Interrupted(Threads):
        def submit(self, function, /, *arguments, **settings) -> Future:
            raise KeyboardInterrupt

        def shutdown(self, *arguments, **settings) -> None:
            closed.append(True)
            super().shutdown(*arguments, **settings)

    monkeypatch.setattr(runs, "WorkerPool", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        runs.run_jobs(JOBS, store, Execution(workers=2))
    assert closed and store.results == ()


def test_a_lost_episode_is_explained(store: ResultStore, monkeypatch: pytest.MonkeyPatch) -> None:
    def killed(config: RunConfig, number: int, folder: Path | None) -> EpisodeResult:
        raise LostCallError("2 worker processes were lost; the last one died (exit code -9)")

    monkeypatch.setattr(runs, "run_recorded_episode", killed)
    with pytest.raises(
        SimpickError,
        match=r"episode \d of oracle was lost.*exit code -9.*run the same command again, with fewer --workers",
    ):
        runs.run_jobs(JOBS, store, Execution(workers=2))
