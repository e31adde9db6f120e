"""Reading JSON with errors that name the file, the key and how to fix it."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from simpick.errors import DatasetError


def read_json(path: Path, remedy: str) -> Any:
    """Return the content of a ``.json`` or ``.json.gz``.

    Raises `DatasetError`, which ends with `remedy` if the file is missing.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError as error:
        raise DatasetError(f"no file {path}. {remedy}") from error
    except OSError as error:
        raise DatasetError(f"cannot read {path}: {error.strerror}. {remedy}") from error
    try:
        return json.loads(gzip.decompress(content) if path.suffix == ".gz" else content)
    except json.JSONDecodeError as error:
        raise DatasetError(
            f"{path}, line {error.lineno}, column {error.colno}: not JSON ({error.msg}). The file may be truncated: "
            "fetch or write it again."
        ) from error
    except (OSError, EOFError, UnicodeDecodeError) as error:
        raise DatasetError(f"{path}: neither text nor a complete gzip file ({error}). Fetch it again.") from error


def read_json_by_id(path: Path, remedy: str) -> dict[int, Any]:
    """Return a JSON object whose keys are numbers, such as image ids, in ascending order."""
    content = read_json(path, remedy)
    if not isinstance(content, dict):
        raise DatasetError(f"{path}: expected an object with one entry per id, got a {type(content).__name__}.")
    try:
        return {key: content[name] for key, name in sorted((int(name), name) for name in content)}
    except ValueError as error:
        bad = next(name for name in content if not name.lstrip("-").isdigit())
        raise DatasetError(f"{path}, key {bad!r}: keys must be whole numbers, such as image or object ids.") from error


def numbers(entry: Any, keys: str | tuple[str, ...], count: int, where: str) -> Float[np.ndarray, "{count}"] | None:
    """Return `count` finite numbers under the first of `keys` that the entry has, flattened; None if it has none."""
    keys = (keys,) if isinstance(keys, str) else keys
    if not isinstance(entry, dict):
        raise DatasetError(f"{where}: expected an object, got a {type(entry).__name__}.")
    key = next((k for k in keys if k in entry), None)
    if key is None:
        return None
    try:
        values = np.asarray(entry[key], float).ravel()
    except (TypeError, ValueError) as error:
        raise DatasetError(f"{where}, key {key!r}: expected {count} numbers, got {entry[key]!r}.") from error
    if values.size != count:
        raise DatasetError(f"{where}, key {key!r}: expected {count} numbers, got {values.size}.")
    if not np.isfinite(values).all():
        raise DatasetError(f"{where}, key {key!r}: numbers must be finite, got {values.tolist()}.")
    return values


def required_numbers(entry: Any, keys: str | tuple[str, ...], count: int, where: str) -> Float[np.ndarray, "{count}"]:
    """Return `count` finite numbers, or raise `DatasetError` naming the missing key."""
    values = numbers(entry, keys, count, where)
    if values is None:
        name = keys if isinstance(keys, str) else keys[0]
        raise DatasetError(f"{where}: has no key {name!r}, only {', '.join(sorted(entry)) or 'none'}.")
    return values


def required_id(entry: Any, key: str, where: str) -> int:
    """Return a whole number, or raise `DatasetError` naming the key."""
    value = entry.get(key) if isinstance(entry, dict) else None
    if not isinstance(value, int) or isinstance(value, bool):
        raise DatasetError(f"{where}, key {key!r}: must be a whole number, got {value!r}.")
    return value
