"""`Closing`: context managers that close on exit."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TypeVar

_Self = TypeVar("_Self")


class Closing(ABC):
    """Base of classes that hold resources; a context manager that calls `close` on every exit."""

    @abstractmethod
    def close(self) -> None:
        """Free the resources; may be called again."""

    def __enter__(self: _Self) -> _Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
