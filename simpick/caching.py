"""The folder for what is expensive to make and safe to lose, and writes that no other process sees half done."""

from __future__ import annotations

import hashlib
import os
import uuid
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from simpick.errors import OutputError


def cache_dir() -> Path:
    """Return the cache's root: ``$SIMPICK_CACHE``, else ``$XDG_CACHE_HOME/simpick``, else ``~/.cache/simpick``.

    The folder is not made here; `atomic_path` makes what it needs.
    """
    if explicit := os.environ.get("SIMPICK_CACHE"):
        return Path(explicit).expanduser()
    if xdg := os.environ.get("XDG_CACHE_HOME"):
        return Path(xdg).expanduser() / "simpick"
    return Path.home() / ".cache" / "simpick"


def cache_key(version: int, *ingredients: str | bytes | int | float) -> str:
    """Return a hash of everything that a cached file was made from.

    `version` belongs to the code that makes the file: raise it when the result would differ, and old files are
    simply never found again.
    """
    digest = hashlib.sha256(f"v{version}".encode())
    for ingredient in ingredients:
        content = ingredient if isinstance(ingredient, bytes) else repr(ingredient).encode()
        # The length keeps ("ab", "c") apart from ("a", "bc").
        digest.update(len(content).to_bytes(8, "little") + content)
    return digest.hexdigest()[:24]


def read_npz(path: Path) -> dict[str, np.ndarray] | None:
    """Return the arrays of an ``.npz`` file by name; None if it is missing or damaged, and should be made anew."""
    try:
        # Opened here, because numpy leaves the handle of a damaged file open.
        with path.open("rb") as handle, np.load(handle, allow_pickle=False) as file:
            return dict(file)
    except (OSError, ValueError, TypeError, EOFError, zipfile.BadZipFile, zlib.error):
        return None


@contextmanager
def atomic_path(target: Path) -> Iterator[Path]:
    """Yield a temporary path beside `target`; on a clean exit it takes target's place in one step.

    Several processes may write the same target at once: each reader sees one whole file, the last writer's. The
    temporary name keeps target's suffix, because many writers choose a format by it. Raises `OutputError` where
    the folder cannot be written.
    """
    temporary: Path | None = None
    try:
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            temporary = target.parent / f".{target.stem}-{uuid.uuid4().hex}{target.suffix}"
            # Not tempfile.mkstemp, whose files nobody but their owner may read.
            temporary.touch(exist_ok=False)
        except OSError as error:
            raise OutputError(
                f"cannot write to {target.parent}: {error.strerror}. Choose another folder, or set SIMPICK_CACHE "
                "if this is the cache."
            ) from error
        yield temporary
        temporary.replace(target)
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def atomic_write_bytes(target: Path, content: bytes) -> None:
    """Write `content` to `target` in one step."""
    with atomic_path(target) as temporary:
        temporary.write_bytes(content)


def atomic_write_text(target: Path, content: str) -> None:
    """Write `content` to `target` as UTF-8 in one step."""
    atomic_write_bytes(target, content.encode())
