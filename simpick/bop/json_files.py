"""Reading JSON with errors that name the file, the key and how to fix it; numbers are checked before they are used."""

from __future__ import annotations

import gzip
import json
import re
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from simpick.errors import DatasetError
from simpick.json_text import load_json

MAX_ID = 2**31 - 1
"""Largest id of a scene, an image or an object, and largest count."""
MAX_NUMBER = 1e12
"""Largest number of any kind: in millimetres a million kilometres, and its square is far from overflow."""
_MAX_BYTES = 4 * 2**30
"""Of a decompressed file: damage must not fill the memory."""


def read_json(path: Path, remedy: str) -> Any:
    """Return the content of a ``.json`` or ``.json.gz``.

    Raises `DatasetError`, which ends with `remedy` if the file is missing.
    """
    try:
        return load_json(_unzipped(path) if path.suffix == ".gz" else path.read_bytes())
    except FileNotFoundError as error:
        raise DatasetError(f"no file {path}. {remedy}") from error
    except json.JSONDecodeError as error:
        raise DatasetError(
            f"{path}, line {error.lineno}, column {error.colno}: not JSON ({error.msg}). The file may be truncated: "
            "fetch or write it again."
        ) from error
    except (gzip.BadGzipFile, EOFError, zlib.error, UnicodeDecodeError) as error:
        raise DatasetError(f"{path}: neither text nor a complete gzip file ({error}). Fetch it again.") from error
    except OSError as error:
        raise DatasetError(f"cannot read {path}: {error.strerror}. {remedy}") from error
    except ValueError as error:
        raise DatasetError(f"{path}: {error}; the file is damaged, or of another kind.") from error


def read_json_by_id(path: Path, remedy: str) -> dict[int, Any]:
    """Return a JSON object whose keys are numbers, such as image ids, in ascending order."""
    content = read_json(path, remedy)
    if not isinstance(content, dict):
        raise DatasetError(f"{path}: expected an object with one entry per id, got a {type(content).__name__}.")
    entries: dict[int, Any] = {}
    for name, entry in content.items():
        key = id_from_text(name)
        if key is None:
            raise DatasetError(
                f"{path}, key {name[:60]!r}: keys must be whole numbers from 0 to {MAX_ID}, such as image or object "
                "ids."
            )
        if key in entries:
            raise DatasetError(f"{path}, key {name[:60]!r}: a second entry of {key}; remove one of them.")
        entries[key] = entry
    return dict(sorted(entries.items()))


def id_from_text(text: str) -> int | None:
    """Return the id that a text states in decimal digits; None if it is no whole number from 0 to `MAX_ID`."""
    value = int(text) if re.fullmatch(r"\d{1,10}", text, re.ASCII) else -1
    return value if 0 <= value <= MAX_ID else None


def number_from_text(text: str) -> float:
    """Return the number that a text states in the notation of JSON and CSV; raises ValueError for any other."""
    # float() also takes "1_000", and digits of all scripts.
    if not text.isascii() or "_" in text:
        raise ValueError(f"no number: {text[:60]!r}")
    return float(text)


def numbers(entry: Any, keys: str | tuple[str, ...], count: int, where: str) -> Float[np.ndarray, "{count}"] | None:
    """Return `count` numbers under the first of `keys` that the entry has, flattened; None if it has none.

    Raises `DatasetError` for other types, and for numbers that are not finite or above `MAX_NUMBER`.
    """
    keys = (keys,) if isinstance(keys, str) else keys
    if not isinstance(entry, dict):
        raise DatasetError(f"{where}: expected an object, got a {type(entry).__name__}.")
    key = next((k for k in keys if k in entry), None)
    return None if key is None else checked_numbers(entry[key], count, f"{where}, key {key!r}")


def checked_numbers(value: Any, count: int, where: str) -> Float[np.ndarray, "{count}"]:
    """Return `count` numbers of a value from a file, flattened; raises `DatasetError` as `numbers` does."""
    items = list(_flat(value))
    if not all(type(item) in (int, float) for item in items):
        raise DatasetError(f"{where}: expected {count} numbers, got {value!r:.100}.")
    if len(items) != count:
        raise DatasetError(f"{where}: expected {count} numbers, got {len(items)}.")
    # Compared as Python numbers, because an integer may exceed all floats; NaN fails every comparison.
    if not all(abs(item) <= MAX_NUMBER for item in items):
        raise DatasetError(
            f"{where}: numbers must be finite and at most {MAX_NUMBER:g}, got {', '.join(map(str, items))[:200]}."
        )
    return np.array(items, float)


def _flat(value: Any) -> Iterator[Any]:
    if isinstance(value, list):
        for item in value:
            yield from _flat(item)
    else:
        yield value


def required_numbers(entry: Any, keys: str | tuple[str, ...], count: int, where: str) -> Float[np.ndarray, "{count}"]:
    """Return `count` finite numbers, or raise `DatasetError` naming the missing key."""
    values = numbers(entry, keys, count, where)
    if values is None:
        name = keys if isinstance(keys, str) else keys[0]
        raise DatasetError(f"{where}: has no key {name!r}, only {', '.join(sorted(entry)) or 'none'}.")
    return values


def positive_number(entry: Any, key: str, where: str, remedy: str) -> float:
    """Return a number above 0, or raise `DatasetError` naming the key."""
    value = float(required_numbers(entry, key, 1, where)[0])
    if value <= 0:
        raise DatasetError(f"{where}, key {key!r}: must be above 0, got {value:g}. {remedy}")
    return value


def required_id(entry: Any, key: str, where: str) -> int:
    """Return a whole number from 0 to `MAX_ID`, or raise `DatasetError` naming the key."""
    return checked_id(entry.get(key) if isinstance(entry, dict) else None, f"{where}, key {key!r}")


def checked_id(value: Any, where: str) -> int:
    """Return a value from a file that is a whole number from 0 to `MAX_ID`, or raise `DatasetError`."""
    if type(value) is not int:
        raise DatasetError(f"{where}: must be a whole number, got {value!r:.100}.")
    if not 0 <= value <= MAX_ID:
        raise DatasetError(f"{where}: must be from 0 to {MAX_ID}, got {value!r:.100}.")
    return value


def checked_list(value: Any, where: str) -> list[Any]:
    """Return a value from a file that is a list, or raise `DatasetError`."""
    if not isinstance(value, list):
        raise DatasetError(f"{where}: expected a list, got a {type(value).__name__}.")
    return value


def _unzipped(path: Path) -> bytes:
    with gzip.open(path) as stream:
        content = stream.read(_MAX_BYTES + 1)
    if len(content) > _MAX_BYTES:
        raise ValueError(f"must hold at most {_MAX_BYTES >> 30} GiB of text")
    return content
