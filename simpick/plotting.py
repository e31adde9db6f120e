"""Plots: matplotlib figures that need neither a display nor pyplot's global state."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from simpick.caching import atomic_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def new_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty figure whose axes are laid out so that labels do not overlap; the size is in inches."""
    # Only here: matplotlib takes 0.2 s to import, and most commands draw nothing.
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), layout="constrained")


def save_figure(figure: Figure, file: Path, dpi: int = 130) -> None:
    """Write the figure as an image of the format that the file's name ends in, whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    with atomic_path(file) as temporary:
        figure.savefig(temporary, dpi=dpi)
