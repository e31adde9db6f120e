"""Strategies that damage files: bytes that flip, and values of JSON that become anything else."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from tests.runtime_types import unchecked

FUZZ = settings(
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow, HealthCheck.data_too_large],
)
"""The number of examples is that of the profile: 100, and with ``make fuzz`` 5000."""


@contextmanager
def refusing(kind: type[Exception] | tuple[type[Exception], ...], *names: str) -> Iterator[None]:
    """Allow errors of a kind whose text names one of the files; every other one fails the test.

    Types are not checked at run time meanwhile: an error of those checks is none that a user meets.
    """
    try:
        with unchecked():
            yield
    except kind as error:
        if not any(name in str(error) for name in names):
            raise


@contextmanager
def restored(file: Path) -> Iterator[bytes]:
    """Give the content of a file and write it back afterwards, so that no example sees the damage of one before."""
    whole = file.read_bytes()
    try:
        yield whole
    finally:
        file.write_bytes(whole)


_SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-3, 3)
    | st.sampled_from([2**31, 2**62, 2**63, 2**64, 10**400, -(10**400), 1e-320, 1e308, -1e13, 0.5, -0.0])
    | st.floats()
    | st.sampled_from(["", "--1", "²", "nan", "1", "0" * 300, "\ud800", "[/b]", "../../x", "\x00"])
)
WILD = st.recursive(
    _SCALARS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(["size", "counts", "1", "--1"]), inner),
    max_leaves=6,
)
"""Any JSON value, the bad ones first."""


@st.composite
def damaged_bytes(draw: st.DrawFn, whole: bytes) -> bytes:
    """Return the bytes with some of them changed, cut off or inserted."""
    content = bytearray(whole)
    for _ in range(draw(st.integers(1, 3))):
        if not content:
            break
        k = draw(st.integers(0, len(content) - 1))
        how = draw(st.sampled_from(["flip", "flip", "flip", "cut", "insert", "remove"]))
        if how == "flip":
            content[k] ^= draw(st.integers(1, 255))
        elif how == "cut":
            del content[k:]
        elif how == "insert":
            content[k:k] = draw(st.binary(max_size=8))
        else:
            del content[k : k + draw(st.integers(1, 8))]
    return bytes(content)


@st.composite
def damaged_value(draw: st.DrawFn, whole: Any) -> Any:
    """Return a JSON value in which one to three values, keys or items are replaced, removed or repeated."""
    value = copy.deepcopy(whole)
    for _ in range(draw(st.integers(1, 3))):
        places = list(_places(value))
        if not places:
            return draw(WILD)
        container, key = draw(st.sampled_from(places))
        how = draw(st.sampled_from(["replace", "replace", "replace", "remove", "repeat", "rename"]))
        if how == "replace":
            container[key] = draw(WILD)
        elif how == "remove":
            del container[key]
        elif isinstance(container, list):
            container.append(container[key])
        else:
            container[draw(st.sampled_from(["--1", "²", "-1", "01", "x"]))] = container.pop(key)
    return value


def _places(value: Any) -> Any:
    """Yield each container with each of its keys."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in list(items):
        yield value, key
        yield from _places(item)
