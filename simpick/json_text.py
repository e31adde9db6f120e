"""Parsing of JSON from files that may be damaged or hostile: every fault is a `ValueError`."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

MAX_NESTING = 64
"""Of lists and objects; no file of simpick or BOP needs more than 10."""


def load_json(content: bytes | str) -> Any:
    """Return the value of a JSON text.

    Raises:
        ValueError: it is no JSON (`json.JSONDecodeError`), no UTF-8 (`UnicodeDecodeError`), nested more than
            `MAX_NESTING` deep, or holds a number of more digits than Python converts.
    """
    try:
        value = json.loads(content)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    level = [value]
    for _ in range(MAX_NESTING + 1):
        level = [item for outer in level for item in _items(outer) if isinstance(item, dict | list)]
        if not level:
            return value
    raise ValueError(_TOO_DEEP)


def is_json(content: bytes | str) -> bool:
    """Return whether a text is whole: a line that was cut off while it was written is not."""
    try:
        load_json(content)
    except ValueError:
        return False
    return True


def _items(value: Any) -> Iterable[Any]:
    return value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()


_TOO_DEEP = f"lists and objects must be nested at most {MAX_NESTING} deep"
