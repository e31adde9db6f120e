"""Environments that close themselves."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import TypeVar

import gymnasium
import pytest

_Env = TypeVar("_Env", bound=gymnasium.Env)


@pytest.fixture
def opened() -> Iterator[Callable[[_Env], _Env]]:
    """Return a function that passes an environment on and closes it after the test."""
    with ExitStack() as stack:
        yield stack.enter_context
