"""`DeviceViews`: all views of a training run's bins in the memory of a device, read as the bins become ready."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import wait as wait_for
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch

from simpick.closing import Closing
from simpick.errors import ConfigError
from simpick.training.detector.bin_files import read_view
from simpick.training.detector.config import DetectorTrainConfig
from simpick.training.detector.crop_plans import Areas
from simpick.training.detector.crops import instance_areas
from simpick.training.detector.step_draws import View
from simpick.training.graceful_stop import GracefulStop

MEMORY_SHARE = 0.6
"""Of a GPU's free memory: where all views take more, crops are not cut there unless that is asked for."""
_POLL_S = 0.2


@dataclass(frozen=True, eq=False)
class _StoredBin:
    """A bin in the device's memory."""

    first_row: int
    """Row of its first view."""
    areas: list[Areas]
    """Of the instances in each view."""


def views_bytes(config: DetectorTrainConfig) -> int:
    """Return the memory that all views of a run take."""
    data = config.data
    return (config.bins + config.curved_bins) * data.views * (4 * data.height_px * data.width_px + 3)


def do_views_fit(config: DetectorTrainConfig, device: torch.device) -> bool:
    """Return whether all views take at most `MEMORY_SHARE` of the memory that a GPU has free."""
    return views_bytes(config) <= MEMORY_SHARE * torch.cuda.mem_get_info(device)[0]


class DeviceViews(Closing):
    """Views as they were rendered, one row of each tensor per view. A context manager.

    Rows are filled in the order in which bins are read, which depends on time; nothing else does.
    """

    def __init__(
        self, config: DetectorTrainConfig, bins: Callable[[], Sequence[Path]], device: torch.device, readers: int
    ) -> None:
        """Reserve the memory for all bins of a run; `bins` returns the files that are ready, `readers` threads read.

        Raises:
            ConfigError: the device has too little memory.
        """
        self.device, self._bins, self._views = device, bins, config.data.views
        rows, size = (config.bins + config.curved_bins) * self._views, (config.data.height_px, config.data.width_px)
        try:
            self.rgb = torch.empty((rows, 3, *size), dtype=torch.uint8, device=device)
            self.ids = torch.empty((rows, *size), dtype=torch.uint8, device=device)
            self.blanks = torch.empty((rows, 3), dtype=torch.uint8, device=device)
        except RuntimeError as error:
            raise ConfigError(
                f"the views of all bins take {views_bytes(config) / 2**30:.1f} GiB, which {device} does not have free; "
                "train with fewer bins or views, or with --crops loaders"
            ) from error
        self._pool = ThreadPoolExecutor(readers, thread_name_prefix="bin-reader")
        self._pending: dict[Path, Future[_StoredBin]] = {}
        self._stored: dict[Path, _StoredBin] = {}
        # Copies on a stream of their own do not wait for training.
        self._stream = torch.cuda.Stream(device) if device.type == "cuda" else None

    def wait(self, graceful_stop: GracefulStop) -> None:
        """Return when all bins whose files are ready now have been read.

        Raises:
            KeyboardInterrupt: a stop was requested.
            DatasetError: a file is missing or damaged.
        """
        self.ready()
        pending = set(self._pending.values())
        while pending and not graceful_stop.requested:
            pending = wait_for(pending, _POLL_S).not_done
        if graceful_stop.requested:
            raise KeyboardInterrupt
        self.ready()

    def ready(self) -> list[Path]:
        """Return the files whose views are stored, in the order of `bins`, and begin to read those that are new.

        Raises:
            DatasetError: a file is missing or damaged.
        """
        files = self._bins()
        for file in files:
            if file not in self._stored and file not in self._pending:
                first_row = (len(self._stored) + len(self._pending)) * self._views
                self._pending[file] = self._pool.submit(self._read, file, first_row)
        for file in [file for file, reading in self._pending.items() if reading.done()]:
            self._stored[file] = self._pending.pop(file).result()
        return [file for file in files if file in self._stored]

    def row(self, view: View) -> int:
        """Return the row of a view whose file is among `ready`."""
        file, number = view
        return self._stored[file].first_row + number

    def areas(self, view: View) -> Areas:
        """Return the areas of the instances in a view whose file is among `ready`."""
        file, number = view
        return self._stored[file].areas[number]

    def close(self) -> None:
        """Stop reading; what is stored stays."""
        self._pool.shutdown(cancel_futures=True)

    def _read(self, file: Path, first_row: int) -> _StoredBin:
        images = [read_view(file, k) for k in range(self._views)]
        rgb = np.stack([image.rgb.transpose(2, 0, 1) for image in images])
        # What lies outside of a view gets its mean colour, in whole grey levels as OpenCV fills it in.
        blanks = np.rint([cv2.mean(image.rgb)[:3] for image in images]).astype(np.uint8)
        rows = slice(first_row, first_row + self._views)
        with torch.cuda.stream(self._stream):
            self.rgb[rows].copy_(torch.from_numpy(rgb))
            self.ids[rows].copy_(torch.from_numpy(np.stack([image.ids for image in images])))
            self.blanks[rows].copy_(torch.from_numpy(blanks))
        if self._stream is not None:
            self._stream.synchronize()
        return _StoredBin(first_row, [instance_areas(image.ids) for image in images])
