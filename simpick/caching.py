"""The cache folder, files of arrays, and writes that other processes see whole or not at all."""

from __future__ import annotations

import errno
import hashlib
import io
import logging
import os
import uuid
import zipfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import platformdirs

from simpick.errors import ArrayFileError, OutputError

_LOG = logging.getLogger(__name__)
_NPY = ".npy"
_MAX_BYTES = 16 * 2**30
"""Of a file's arrays: a damaged size must not fill the memory."""
_STEM_CHARACTERS = 40
_REMEDIES = {
    errno.ENOSPC: "Make room",
    errno.EDQUOT: "Make room",
    errno.ENAMETOOLONG: "Choose a shorter name",
}
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


def cache_name(name: str, key: str, suffix: str = ".npz") -> str:
    """Return the name of a cached file of arrays; `name` is for humans, and is cut where file systems would refuse."""
    return f"{name[:_STEM_CHARACTERS]}-{key}{suffix}"


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


def read_arrays(path: Path, names: Collection[str] | None = None) -> dict[str, np.ndarray]:
    """Return the arrays of a file by name; other members than ``.npy`` come as arrays of bytes (uint8).

    With `names`, only those of them that the file holds are read.

    Raises:
        FileNotFoundError: there is no such file.
        ArrayFileError: the file is damaged, or no file of arrays.
    """
    try:
        # Each member carries a checksum, which reading compares.
        with zipfile.ZipFile(path) as file:
            if (size := sum(member.file_size for member in file.infolist())) > _MAX_BYTES:
                raise ValueError(f"it states a size of {size} bytes")
            members = {member.removesuffix(_NPY): member for member in file.namelist()}
            wanted = members.keys() if names is None else members.keys() & set(names)
            return {name: _array(member, file.read(member)) for name, member in members.items() if name in wanted}
    except FileNotFoundError:
        raise
    # zipfile and numpy fail by a dozen kinds of errors, depending on which byte is damaged.
    except Exception as error:
        raise ArrayFileError(f"{path} must be a whole file of arrays, is damaged or foreign ({error})") from error


def _array(name: str, content: bytes) -> np.ndarray:
    if name.endswith(_NPY):
        return np.lib.format.read_array(io.BytesIO(content), allow_pickle=False)
    return np.frombuffer(content, np.uint8)


def numbers(arrays: Mapping[str, np.ndarray], name: str, kinds: str, *shape: int | None) -> np.ndarray:
    """Return an array if it has one of these kinds (numpy's letters), this shape (None: any size) and finite values.

    Raises `ValueError` where it does not.
    """
    values = arrays[name]
    fits = values.ndim == len(shape) and all(n in (None, size) for n, size in zip(shape, values.shape, strict=True))
    if not fits or values.dtype.kind not in kinds or not np.isfinite(values).all():
        wanted = " x ".join("n" if n is None else str(n) for n in shape)
        raise ValueError(f"{name} must be {wanted} finite numbers, has shape {values.shape} of {values.dtype}")
    return values


def stored_arrays(path: Path, names: Iterable[str]) -> dict[str, np.ndarray] | None:
    """Return a file's arrays, or None where it is missing, damaged or lacks one of `names`.

    A file that cannot be used is noted in the log, which Python prints: its content is made again.
    """
    try:
        arrays = read_arrays(path)
    except FileNotFoundError:
        return None
    except ArrayFileError as error:
        _LOG.warning("note: %s; its content is made again", error)
        return None
    if lacking := sorted(set(names) - arrays.keys()):
        _LOG.warning("note: %s lacks %s; its content is made again", path, ", ".join(lacking))
        return None
    return arrays


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
    # A name that is as long as names may be leaves no room for more characters.
    temporary = target.parent / f".{target.stem[:_STEM_CHARACTERS]}-{uuid.uuid4().hex}{target.suffix}"
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
            f"cannot write to {target}: {error.strerror or error}. What was there before is kept. "
            f"{_REMEDIES.get(error.errno or 0, 'Choose a folder that you may write to')}, or set SIMPICK_CACHE to "
            "another folder if this is the cache."
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
