"""`BinSupply`: the bins of a training run; training may begin before all of them are made."""

from __future__ import annotations

import threading
from concurrent.futures import Future
from dataclasses import dataclass, replace
from pathlib import Path

from simpick.closing import Closing
from simpick.errors import SceneError, SimpickError
from simpick.training.data.data_config import Split
from simpick.training.detector.bin_data import BinDataConfig
from simpick.training.detector.bin_files import bin_file, write_bin
from simpick.training.detector.config import DetectorTrainConfig
from simpick.training.graceful_stop import GracefulStop
from simpick.workers import LostCallError, WorkerLimits, WorkerPool

# A bin takes 1 to 20 s. One that hangs must not keep the next renderers from starting for long.
_LIMITS = WorkerLimits(first_call_s=90.0, call_s=60.0)
_POLL_S = 0.5


@dataclass(frozen=True)
class _Bin:
    """What a bin is made from, and its file."""

    config: BinDataConfig
    split: Split
    index: int
    path: Path


class BinSupply(Closing):
    """Makes the bins that are missing in renderer processes. A context manager.

    A bin that does not come to rest, or whose renderers died or hung each time, is left out.
    """

    def __init__(self, folder: Path, config: DetectorTrainConfig, renderers: int) -> None:
        """Start to make bins; with `renderers` of 0, `wait` makes all of them in this process."""
        self._folder = folder
        train, self._held_out = _bins(folder, config, "train"), _bins(folder, config, "validation")
        self._first, self._rest = train[: config.min_ready_bins], train[config.min_ready_bins :]
        self._changed = threading.Condition()
        # Guarded by `_changed`.
        self._ready = {bin.path for bin in self._all if bin.path.exists()}
        self._left_out: dict[Path, SimpickError] = {}
        self._error: SimpickError | None = None
        missing = [bin for bin in self._all if bin.path not in self._ready]
        # Staggered, because renderers that start together have been seen to hang.
        self._pool = WorkerPool(renderers, _LIMITS, threads=1, staggered=True) if renderers and missing else None
        if self._pool is not None:
            for bin in missing:
                call = self._pool.submit(write_bin, folder, bin.config, bin.split, bin.index)
                call.add_done_callback(lambda call, bin=bin: self._finish(bin, call))

    @property
    def left_out(self) -> int:
        """Return how many bins could not be made so far."""
        with self._changed:
            return len(self._left_out)

    def train(self) -> list[Path]:
        """Return the files of the training bins that are ready, in an order that does not depend on time.

        Raises:
            SimpickError: a bin could not be made for another reason than that it cannot be simulated or rendered.
        """
        return self._files(self._first + self._rest)

    def held_out(self) -> list[Path]:
        """Return the files of the held-out bins that are ready; raises as `train` does."""
        return self._files(self._held_out)

    def wait(self, graceful_stop: GracefulStop) -> None:
        """Return when `min_ready_bins` of the training bins are ready, or left out, and all of the held-out ones.

        Raises:
            KeyboardInterrupt: a stop was requested; the bins made so far are kept.
            SimpickError: no bin of one of the splits can be made, or see `train`.
        """
        needed = self._first + self._held_out
        for bin in self._all if self._pool is None else []:
            if bin.path not in self._ready and not graceful_stop.requested:
                self._make(bin)
        with self._changed:
            while not graceful_stop.requested and self._error is None and not all(map(self._is_done, needed)):
                self._changed.wait(_POLL_S)
            left_out = dict(self._left_out)
        if graceful_stop.requested:
            raise KeyboardInterrupt
        if not (self.train() and self.held_out()):
            raise next(iter(left_out.values()))

    def close(self) -> None:
        """Stop the renderers; finished bins remain for the next run."""
        if self._pool is not None:
            self._pool.close()

    @property
    def _all(self) -> list[_Bin]:
        """All bins, in the order in which they are made."""
        return self._first + self._held_out + self._rest

    def _files(self, bins: list[_Bin]) -> list[Path]:
        with self._changed:
            if self._error is not None:
                raise self._error
            return [bin.path for bin in bins if bin.path in self._ready]

    def _is_done(self, bin: _Bin) -> bool:
        return bin.path in self._ready or bin.path in self._left_out

    def _make(self, bin: _Bin) -> None:
        call: Future[None] = Future()
        try:
            call.set_result(write_bin(self._folder, bin.config, bin.split, bin.index))
        except SimpickError as error:
            call.set_exception(error)
        self._finish(bin, call)

    def _finish(self, bin: _Bin, call: Future[None]) -> None:
        error = call.exception()
        with self._changed:
            if error is None:
                self._ready.add(bin.path)
            elif isinstance(error, SceneError | LostCallError):
                self._left_out[bin.path] = error
            elif isinstance(error, SimpickError):
                self._error = self._error or error
            self._changed.notify_all()


def _bins(folder: Path, config: DetectorTrainConfig, split: Split) -> list[_Bin]:
    """Return the bins of a split; bent parts are spread evenly over the list."""
    counts = (config.bins, config.curved_bins)
    if split == "validation":
        counts = tuple(min(config.validation_bins, count) for count in counts)
    bins = [
        ((index + 0.5) / count, _Bin(data, split, index, bin_file(folder, data, split, index)))
        for data, count in zip((config.data, replace(config.data, curved=True)), counts, strict=True)
        for index in range(count)
    ]
    return [bin for _, bin in sorted(bins, key=lambda place_and_bin: place_and_bin[0])]
