"""The checks of types and shapes that every annotated function of the package gets during tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from inspect import isclass
from typing import Any

import jaxtyping
from beartype import BeartypeConf, beartype
from jaxtyping import install_import_hook, jaxtyped

CHECKED_CALLS = 200
"""Calls of a function that are checked in one process, and thereafter every 50th: a loop calls some a million times."""

_off = False

# Python's own rule (PEP 484): where a float is asked for, an int will do.
check = beartype(conf=BeartypeConf(is_pep484_tower=True))


def install() -> None:
    """Check every function of simpick that is imported from now on."""
    jaxtyping.jaxtyped = _sampled
    install_import_hook("simpick", "tests.runtime_types.check")


@contextmanager
def unchecked() -> Iterator[None]:
    """Check no calls in the block, so that a test of bad input meets the errors that a user meets."""
    global _off
    _off = True
    try:
        yield
    finally:
        _off = False


def _sampled(*, typechecker: Callable) -> Callable:
    decorate = jaxtyped(typechecker=typechecker)

    def both(function: Any) -> Any:
        checked = decorate(function)
        if isclass(function) or checked is function:
            return checked
        calls = 0

        @wraps(function)
        def sampled(*args: Any, **kwargs: Any) -> Any:
            nonlocal calls
            calls += 1
            is_checked = not _off and (calls <= CHECKED_CALLS or calls % 50 == 0)
            return (checked if is_checked else function)(*args, **kwargs)

        return sampled

    return both
