"""What commands write: images, checked before any work, and the command that opens a recording."""

from __future__ import annotations

import shlex
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from simpick.errors import ConfigError, OutputError

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import UInt8


def check_image(file: Path, *, overwrite: bool) -> None:
    """Raise unless `file` is a PNG image that does not exist or may be replaced, before time is spent on it.

    Raises:
        ConfigError: the file's name does not end in .png.
        OutputError: the file exists, and `overwrite` is false.
    """
    if file.suffix.lower() != ".png":
        raise ConfigError(f"out must be a .png file, got {str(file)!r}")
    if file.exists() and not overwrite:
        raise OutputError(f"{file} exists already. Choose another file with --out, or pass --overwrite.")


def write_image(file: Path, rgb: UInt8[np.ndarray, "height width 3"]) -> None:
    """Write a PNG image, whole or not at all; raises OutputError."""
    # Only here: they take time to import.
    import cv2

    from simpick.caching import atomic_write_bytes

    atomic_write_bytes(file, cv2.imencode(".png", rgb[:, :, ::-1])[1].tobytes())


def counted(number: int, noun: str) -> str:
    """Return a number with its noun, such as ``1 bin`` and ``2 bins``."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def viewer_command(recording: Path) -> str:
    """Return the command that opens a recording: with the viewer's path if it is beside Python, but not on PATH."""
    beside = Path(sys.executable).with_name("rerun")
    viewer = str(beside) if beside.is_file() and shutil.which("rerun") is None else "rerun"
    return shlex.join([viewer, str(recording)])
