"""Pairs of cells for which the network predicts whether one instance covers both: a star of offsets per cell."""

from __future__ import annotations

OFFSETS: tuple[tuple[int, int], ...] = (
    (0, 1),
    (1, 0),
    *((dy * d, dx * d) for d in (4, 9, 18, 32) for dy, dx in ((0, 1), (1, 0))),
    *((dy * d, dx * d) for d in (3, 6, 13, 23) for dy, dx in ((1, 1), (1, -1))),
)
"""(rows, columns) from each cell to its partner, in cells of `STRIDE` px; the opposite offsets are implied.
Rows are never negative."""
STRIDE = 2
"""Side of a cell in pixels."""

Window = tuple[slice, slice]


def pair_windows(height: int, width: int, offset: tuple[int, int]) -> tuple[Window, Window]:
    """Return the rows and columns of all first cells that have a partner at `offset`, and those of the partners."""
    dy, dx = offset
    rows, columns = max(height - dy, 0), max(width - abs(dx), 0)
    left, right = max(0, -dx), max(0, dx)
    first = (slice(0, rows), slice(left, left + columns))
    second = (slice(height - rows, height), slice(right, right + columns))
    return first, second
