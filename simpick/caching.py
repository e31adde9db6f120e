"""The cache folder, files of arrays, and writes that other processes see whole or not at all."""

from __future__ import annotations

import hashlib
import io
import os
import uuid
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import platformdirs

from simpick.errors import ArrayFileError, OutputError

_NPY = ".npy"
_FAST = 1
"""Compression level: the next one makes images a fifth smaller in three times the time."""


def cache_dir() -> Path:
    """Return the cache's root: ``$SIMPICK_CACHE``, else the user's cache folder (on Linux ``~/.cache/simpick``).

    The folder is not made here; `atomic_path` makes what it needs.
    """
    if explicit := os.environ.get("SIMPICK_CACHE"):
        return Path(explicit).expanduser()
    return platformdirs.user_cache_path("simpick", appauthor=False)


def cache_key(version: int, *ingredients: str | bytes | int | float) -> str:
    """Return a hash of everything that a cached file was made from.

    `version` belongs to the code that makes the file: raise it when the result would differ; old files are then
    ignored.
    """
    digest = hashlib.sha256(f"v{version}".encode())
    for ingredient in ingredients:
        content = ingredient if isinstance(ingredient, bytes) else repr(ingredient).encode()
        # The length distinguishes ("ab", "c") from ("a", "bc").
        digest.update(len(content).to_bytes(8, "little") + content)
    return digest.hexdigest()[:24]


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays to one ``.npz`` file in one step, compressed, each with a checksum; equal arrays, equal bytes.

    Raises `OutputError` where the file cannot be written.
    """
    with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w") as file:
        for name, array in arrays.items():
            content = io.BytesIO()
            np.lib.format.write_array(content, np.asanyarray(array), allow_pickle=False)
            # A member without a date: files of equal arrays are equal.
            member = zipfile.ZipInfo(name + _NPY)
            file.writestr(member, content.getvalue(), zipfile.ZIP_DEFLATED, _FAST)


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of a file by name; other members than ``.npy`` come as arrays of bytes (uint8).

    Raises:
        FileNotFoundError: there is no such file.
        ArrayFileError: the file is damaged, or no file of arrays.
    """
    try:
        # Each member carries a checksum, which reading compares.
        with zipfile.ZipFile(path) as file:
            return {name.removesuffix(_NPY): _array(name, file.read(name)) for name in file.namelist()}
    except FileNotFoundError:
        raise
    # A truncated, damaged or foreign file fails as any of these, depending on where it breaks off.
    except (OSError, ValueError, KeyError, EOFError, NotImplementedError, RuntimeError,
            zipfile.BadZipFile, zlib.error) as error:  # fmt: skip
        raise ArrayFileError(f"{path} must be a whole file of arrays, is damaged or foreign ({error})") from error


def _array(name: str, content: bytes) -> np.ndarray:
    if name.endswith(_NPY):
        return np.lib.format.read_array(io.BytesIO(content), allow_pickle=False)
    return np.frombuffer(content, np.uint8)


def stored_arrays(path: Path, names: Iterable[str]) -> dict[str, np.ndarray] | None:
    """Return a file's arrays, or None where it is missing, damaged or lacks one of `names`."""
    try:
        arrays = read_arrays(path)
    except (FileNotFoundError, ArrayFileError):
        return None
    return arrays if arrays.keys() >= set(names) else None


def cached_arrays(
    path: Path, names: Iterable[str], make: Callable[[], Mapping[str, np.ndarray]]
) -> dict[str, np.ndarray]:
    """Return a cache file's arrays; where it is missing or damaged, make them and write the file.

    Any number of processes may ask at once. Raises `OutputError` where the cache cannot be written.
    """
    for used in _watchers:
        used.append(path)
    arrays = stored_arrays(path, names)
    if arrays is None:
        arrays = dict(make())
        write_arrays(path, arrays)
    return arrays


_watchers: list[list[Path]] = []


@contextmanager
def files_used() -> Iterator[list[Path]]:
    """Yield a list of the files that `cached_arrays` is asked for meanwhile, in this process."""
    used: list[Path] = []
    _watchers.append(used)
    try:
        yield used
    finally:
        _watchers.remove(used)


@contextmanager
def atomic_path(target: Path) -> Iterator[Path]:
    """Yield a temporary path beside `target`; on a clean exit it takes target's place in one step.

    Several processes may write the same target at once: each reader sees one whole file, the last writer's. The
    temporary name keeps target's suffix, because many writers choose a format by it.

    Raises:
        OutputError: the folder cannot be written, or the disk is full; its cause is the operating system's error.
    """
    temporary = target.parent / f".{target.stem}-{uuid.uuid4().hex}{target.suffix}"
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        # Not tempfile.mkstemp, whose files only their owner may read.
        temporary.touch(exist_ok=False)
        yield temporary
        temporary.replace(target)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(
            f"cannot write to {target}: {error.strerror or error}. Make room, choose another folder, or set "
            "SIMPICK_CACHE if this is the cache."
        ) from error
    finally:
        # Where the folder is a file, even this fails.
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def atomic_write_bytes(target: Path, content: bytes) -> None:
    """Write `content` to `target` in one step."""
    with atomic_path(target) as temporary:
        temporary.write_bytes(content)


def atomic_write_text(target: Path, content: str) -> None:
    """Write `content` to `target` as UTF-8 in one step."""
    atomic_write_bytes(target, content.encode())
