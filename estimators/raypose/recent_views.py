"""`RecentViews`: encoded views of all parts, those used last, in a bounded share of memory."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Generic, TypeVar

from torch import Tensor

from simpick.tensor_record import TensorRecord

MAX_BYTES = 2**29
"""Some 3,700 views with `small`: what 50 detections need in one look, of one kind of part or of many."""

Key = TypeVar("Key", bound=Hashable)
View = TypeVar("View", bound=TensorRecord)


class RecentViews(Generic[Key, View]):
    """Views by their keys; where they take more than `max_bytes`, those used longest ago are dropped."""

    def __init__(self, max_bytes: int = MAX_BYTES) -> None:
        self.max_bytes = max_bytes
        self.bytes = 0
        """Held now."""
        self._views: dict[Key, tuple[View, int]] = {}

    def __len__(self) -> int:
        return len(self._views)

    def get(self, keys: Sequence[Key], make: Callable[[list[Key]], Sequence[View]]) -> list[View]:
        """Return the views of these keys; `make` returns those that are missing, which it gets once each."""
        missing = [key for key in dict.fromkeys(keys) if key not in self._views]
        for key, view in zip(missing, make(missing) if missing else (), strict=True):
            size = _bytes_of(view)
            self._views[key] = view, size
            self.bytes += size
        for key in keys:
            self._views[key] = self._views.pop(key)  # The last used come last.
        found = [self._views[key][0] for key in keys]
        while self.bytes > self.max_bytes:
            _, size = self._views.pop(next(iter(self._views)))
            self.bytes -= size
        return found


def _bytes_of(view: TensorRecord) -> int:
    total = 0

    def count(tensor: Tensor) -> Tensor:
        nonlocal total
        total += tensor.numel() * tensor.element_size()
        return tensor

    view.map(count)
    return total
