"""Files of bin images: one per bin, made once and kept."""

from __future__ import annotations

import io
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import mujoco
import numpy as np

from simpick.caching import atomic_write_bytes, cache_key
from simpick.errors import DatasetError
from simpick.training.data.data_config import Split
from simpick.training.detector.bin_data import VERSION, BinDataConfig, BinImage, make_bin
from simpick.training.detector.config import DetectorTrainConfig
from simpick.training.graceful_stop import GracefulStop
from simpick.workers import WorkerPool

_PNG = [cv2.IMWRITE_PNG_COMPRESSION, 3]


def bin_file(folder: Path, config: BinDataConfig, split: Split, index: int) -> Path:
    """Return the file of a bin; its name states all that the images follow from."""
    return folder / f"{split}-{cache_key(VERSION, repr(config), mujoco.__version__)}-{index:05d}.npz"


def ensure_training_bins(
    folder: Path, config: DetectorTrainConfig, split: Split, workers: int, graceful_stop: GracefulStop
) -> list[Path]:
    """Return the files of a split, after making those that are missing; see `ensure_bins`."""
    counts = (config.bins, config.curved_bins)
    if split == "validation":
        counts = tuple(min(config.validation_bins, count) for count in counts)
    kinds = (config.data, replace(config.data, curved=True))
    return [
        path
        for data, count in zip(kinds, counts, strict=True)
        for path in ensure_bins(folder, data, split, count, workers, graceful_stop)
    ]


def ensure_bins(
    folder: Path, config: BinDataConfig, split: Split, count: int, workers: int, graceful_stop: GracefulStop
) -> list[Path]:
    """Return the files of the first `count` bins, after making those that are missing.

    With `workers` of 0 they are made in this process.

    Raises:
        KeyboardInterrupt: a stop was requested; the files made so far are kept.
        SceneError: a bin did not come to rest.
    """
    paths = [bin_file(folder, config, split, index) for index in range(count)]
    missing = [index for index, path in enumerate(paths) if not path.exists()]
    write = partial(write_bin, folder, config, split)
    with WorkerPool(workers, threads=1, staggered=True) if workers and missing else nullcontext() as pool:
        calls = [pool.submit(write, index).result if pool else partial(write, index) for index in missing]
        for call in calls:
            call()
            if graceful_stop.requested:
                raise KeyboardInterrupt
    return paths


def write_bin(folder: Path, config: BinDataConfig, split: Split, index: int) -> None:
    """Make a bin and write its views, as PNG inside npz, whole or not at all."""
    arrays: dict[str, np.ndarray] = {}
    for k, image in enumerate(make_bin(config, index, split)):
        arrays[f"rgb{k}"] = cv2.imencode(".png", image.rgb[..., ::-1], _PNG)[1]
        arrays[f"ids{k}"] = cv2.imencode(".png", image.ids, _PNG)[1]
        arrays[f"fractions{k}"] = image.fractions
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # pyright: ignore[reportArgumentType]
    atomic_write_bytes(bin_file(folder, config, split, index), buffer.getvalue())


def read_view(path: Path, view: int) -> BinImage:
    """Return one view of a bin.

    Raises:
        DatasetError: the file is missing or damaged.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            bgr = np.asarray(cv2.imdecode(file[f"rgb{view}"], cv2.IMREAD_COLOR), np.uint8)
            ids = np.asarray(cv2.imdecode(file[f"ids{view}"], cv2.IMREAD_GRAYSCALE), np.uint8)
            return BinImage(np.ascontiguousarray(bgr[..., ::-1]), ids, file[f"fractions{view}"])
    except Exception as error:
        raise DatasetError(f"{path} is missing or damaged ({error}); delete it, and it is made again") from error
