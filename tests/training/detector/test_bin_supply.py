"""Bins of a training run: what is made first, what is left out, and what stops the run."""

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import pytest

from simpick.errors import OutputError, SceneError
from simpick.training.data.data_config import Split
from simpick.training.detector import bin_supply
from simpick.training.detector.bin_data import BinDataConfig
from simpick.training.detector.bin_files import bin_file
from simpick.training.detector.bin_supply import BinSupply
from simpick.training.graceful_stop import GracefulStop
from simpick.workers import LostCallError
from tests.training.detector.conftest import TINY_TRAINING

CONFIG = replace(TINY_TRAINING, bins=4, curved_bins=2, min_ready_bins=3)


class FakePool:
    """Takes calls and finishes them when the test says so."""

    def __init__(self, *arguments: object, **options: object) -> None:
        self.calls: list[tuple[Callable[..., None], tuple, Future[None]]] = []

    def submit(self, function: Callable[..., None], *arguments: object) -> Future[None]:
        future: Future[None] = Future()
        self.calls.append((function, arguments, future))
        return future

    def finish(self, count: int, error: Exception | None = None) -> None:
        for _ in range(count):
            function, arguments, future = self.calls.pop(0)
            if error is not None:
                future.set_exception(error)
                continue
            function(*arguments)
            future.set_result(None)

    def close(self) -> None:
        self.calls = []


@pytest.fixture
def pool(monkeypatch: pytest.MonkeyPatch) -> FakePool:
    pool = FakePool()

    def touch(folder: Path, config: BinDataConfig, split: Split, index: int) -> None:
        bin_file(folder, config, split, index).touch()

    monkeypatch.setattr(bin_supply, "WorkerPool", lambda *arguments, **options: pool)
    monkeypatch.setattr(bin_supply, "write_bin", touch)
    return pool


def test_training_may_begin_with_the_first_bins_and_the_held_out_ones(pool: FakePool, tmp_path: Path) -> None:
    supply = BinSupply(tmp_path, CONFIG, renderers=2)
    pool.finish(3 + 2)
    supply.wait(GracefulStop())
    assert len(supply.train()) == 3 and len(supply.held_out()) == 2
    pool.finish(3)
    assert len(supply.train()) == 6 and not pool.calls


def test_bent_parts_are_among_the_first_bins(pool: FakePool, tmp_path: Path) -> None:
    BinSupply(tmp_path, CONFIG, renderers=1)
    assert [arguments[1].curved for _, arguments, _ in pool.calls[:3]].count(True) == 1


def test_the_order_of_files_does_not_depend_on_which_is_ready_first(pool: FakePool, tmp_path: Path) -> None:
    supply = BinSupply(tmp_path, CONFIG, renderers=1)
    pool.calls.reverse()
    pool.finish(8)
    assert supply.train() == BinSupply(tmp_path, CONFIG, renderers=1).train()


def test_files_of_an_earlier_run_are_not_made_again(pool: FakePool, tmp_path: Path) -> None:
    BinSupply(tmp_path, CONFIG, renderers=1)
    pool.finish(4)
    pool.calls.clear()
    BinSupply(tmp_path, CONFIG, renderers=1)
    assert len(pool.calls) == 4


@pytest.mark.parametrize("error", [SceneError("no rest"), LostCallError("hung")])
def test_bins_that_cannot_be_made_are_left_out(pool: FakePool, tmp_path: Path, error: Exception) -> None:
    supply = BinSupply(tmp_path, CONFIG, renderers=1)
    pool.finish(1, error)
    pool.finish(4)
    supply.wait(GracefulStop())
    assert len(supply.train()) == 2 and supply.left_out == 1


def test_without_any_bin_the_cause_is_raised(pool: FakePool, tmp_path: Path) -> None:
    supply = BinSupply(tmp_path, CONFIG, renderers=1)
    pool.finish(8, LostCallError("hung"))
    with pytest.raises(LostCallError, match="hung"):
        supply.wait(GracefulStop())


def test_a_full_disk_stops_the_run(pool: FakePool, tmp_path: Path) -> None:
    supply = BinSupply(tmp_path, CONFIG, renderers=1)
    pool.finish(5)
    supply.wait(GracefulStop())
    pool.finish(1, OutputError("disk full"))
    with pytest.raises(OutputError, match="disk full"):
        supply.train()


def test_without_renderers_every_bin_is_made_here(pool: FakePool, tmp_path: Path) -> None:
    supply = BinSupply(tmp_path, CONFIG, renderers=0)
    assert not supply.train()
    supply.wait(GracefulStop())
    assert len(supply.train()) == 6 and not pool.calls


def test_a_requested_stop_ends_the_wait(pool: FakePool, tmp_path: Path) -> None:
    stop = GracefulStop()
    stop.requested = True
    with pytest.raises(KeyboardInterrupt):
        BinSupply(tmp_path, CONFIG, renderers=1).wait(stop)
