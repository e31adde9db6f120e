"""What is being done at this moment, in words: stated where the work is, shown beside whatever progress is displayed.

Preparing parts takes a minute where caches are empty, deep inside calls that know nothing of displays.
"""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterator
from contextlib import contextmanager
from typing import TypeVar

_Item = TypeVar("_Item")


class _Activity:
    """One activity; compared by identity, because two may have the same words."""

    def __init__(self, text: str) -> None:
        self.text = text


_activities: list[_Activity] = []
"""The outermost first. Threads share the list: what any of them does is shown."""


@contextmanager
def doing(text: str) -> Iterator[None]:
    """State what the block does."""
    activity = _Activity(text)
    _activities.append(activity)
    try:
        yield
    finally:
        _activities.remove(activity)


def counted(items: Collection[_Item], text: str) -> Generator[_Item, None, None]:
    """Yield the items while it is stated which one of how many is worked on."""
    for k, item in enumerate(items, 1):
        with doing(f"{text} {k}/{len(items)}"):
            yield item


def current_activity() -> str:
    """Return what is being done, the outermost first; empty if nothing is stated."""
    return ", ".join(activity.text for activity in tuple(_activities))
