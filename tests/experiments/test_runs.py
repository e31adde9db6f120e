"""Several workers: episodes are handed out one by one, so that stopping stops."""

import threading
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import pytest

from simpick.errors import SimpickError
from simpick.experiments import runs
from simpick.experiments.result_store import EpisodeResult, ResultStore
from simpick.experiments.run_config import RunConfig

CONFIG = RunConfig(episodes=8)


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ResultStore:
    """An empty store; workers are threads, which start at once."""
    monkeypatch.setattr(runs, "spawned_pool", ThreadPoolExecutor)
    return ResultStore(tmp_path / "run", CONFIG.to_json())


def test_all_episodes_are_run_once(store: ResultStore, monkeypatch: pytest.MonkeyPatch) -> None:
    store.add(EpisodeResult(3, 3, (), (), "cleared", mode="oracle"))
    run: list[int] = []

    def episode(config: RunConfig, number: int, folder: Path | None) -> EpisodeResult:
        run.append(number)
        return EpisodeResult(number, number, (), (), "cleared", mode="oracle")

    monkeypatch.setattr(runs, "run_recorded", episode)
    runs.run_episodes(CONFIG, store, record=False, workers=3)
    assert sorted(run) == [0, 1, 2, 4, 5, 6, 7]
    assert [result.episode for result in store.results] == list(range(8))


def test_an_interrupt_starts_no_further_episode(store: ResultStore, monkeypatch: pytest.MonkeyPatch) -> None:
    run: list[int] = []
    both = threading.Barrier(2)

    def interrupted(config: RunConfig, number: int, folder: Path | None) -> EpisodeResult:
        run.append(number)
        both.wait(timeout=10)
        raise KeyboardInterrupt

    monkeypatch.setattr(runs, "run_recorded", interrupted)
    with pytest.raises(KeyboardInterrupt):
        runs.run_episodes(CONFIG, store, record=False, workers=2)
    assert sorted(run) == [0, 1]


def test_a_killed_worker_is_explained(store: ResultStore, monkeypatch: pytest.MonkeyPatch) -> None:
    def killed(config: RunConfig, number: int, folder: Path | None) -> EpisodeResult:
        raise BrokenProcessPool("A process in the process pool was terminated abruptly")

    monkeypatch.setattr(runs, "run_recorded", killed)
    with pytest.raises(
        SimpickError,
        match=r"worker process was killed.*Lost: episode 0 of oracle, .*run the same command again, with fewer",
    ):
        runs.run_episodes(CONFIG, store, record=False, workers=2)
