"""The check of the images that commands write."""

from __future__ import annotations

from pathlib import Path

from simpick.errors import ConfigError, OutputError


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
