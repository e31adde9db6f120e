"""Files of bin images: one per bin, made once and kept."""

from __future__ import annotations

import io
from pathlib import Path

import cv2
import mujoco
import numpy as np

from simpick.caching import atomic_write_bytes, cache_key, read_arrays
from simpick.errors import DatasetError
from simpick.training.data.data_config import Split
from simpick.training.detector.bin_data import VERSION, BinDataConfig, BinImage, make_bin

_PNG = [cv2.IMWRITE_PNG_COMPRESSION, 3]


def bin_file(folder: Path, config: BinDataConfig, split: Split, index: int) -> Path:
    """Return the file of a bin; its name states all that the images follow from."""
    return folder / f"{split}-{cache_key(VERSION, repr(config), mujoco.__version__)}-{index:05d}.npz"


def write_bin(folder: Path, config: BinDataConfig, split: Split, index: int) -> None:
    """Make a bin and write its views, as PNG inside npz, whole or not at all."""
    arrays: dict[str, np.ndarray] = {}
    for k, image in enumerate(make_bin(config, index, split)):
        arrays[f"rgb{k}"] = cv2.imencode(".png", image.rgb[..., ::-1], _PNG)[1]
        arrays[f"ids{k}"] = cv2.imencode(".png", image.ids, _PNG)[1]
        if image.fractions is not None:
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
        names = [f"{kind}{view}" for kind in ("rgb", "ids", "fractions")]
        file = read_arrays(path, names)
        bgr = np.asarray(cv2.imdecode(file[names[0]], cv2.IMREAD_COLOR), np.uint8)
        ids = np.asarray(cv2.imdecode(file[names[1]], cv2.IMREAD_GRAYSCALE), np.uint8)
        rgb = cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)
        return BinImage(np.asarray(rgb, np.uint8), ids, file.get(names[2]))
    except Exception as error:
        raise DatasetError(f"{path} is missing or damaged ({error}); delete it, and it is made again") from error
