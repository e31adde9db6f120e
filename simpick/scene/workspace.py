"""Positions in the cell: named constants and boxes in the world frame (metres)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from simpick.scene.config import BinConfig

BIN_CENTRE_M = (0.50, 0.0, 0.0)
"""Centre of the bin's inner floor."""
CHUTE_CENTRE_M = (0.25, -0.45, 0.0)
"""Centre of the inner floor of the container that delivered parts fall into."""
CHUTE = BinConfig(length_m=0.22, width_m=0.22, depth_m=0.10, wall_m=0.006)
"""Inner measures of that container."""
TABLE_Z_M = -0.008
"""Height of the table's top: the underside of a bin with the default wall."""
PILE_HEADROOM_M = 0.06
"""Parts on the pile may protrude above the bin's rim by this much and still count as in the bin."""


@dataclass(frozen=True)
class Box:
    """An axis-aligned box."""

    lower_m: tuple[float, float, float]
    """Its corner with the smallest coordinates."""
    upper_m: tuple[float, float, float]
    """Its corner with the largest coordinates."""

    def contains(self, points: Float[np.ndarray, "*batch 3"]) -> Bool[np.ndarray, "*batch"]:
        """Return which points lie inside."""
        lower_m, upper_m = self._corners_m
        return np.all((points >= lower_m) & (points <= upper_m), axis=-1)

    @cached_property
    def _corners_m(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        return np.array(self.lower_m), np.array(self.upper_m)

    @property
    def centre_m(self) -> Float[np.ndarray, "3"]:
        """Return the middle."""
        return (np.array(self.lower_m) + np.array(self.upper_m)) / 2

    @property
    def size_m(self) -> Float[np.ndarray, "3"]:
        """Return the side lengths."""
        return np.array(self.upper_m) - np.array(self.lower_m)


def _over_floor(centre: tuple[float, float, float], bin: BinConfig, z_lower: float, z_upper: float) -> Box:
    x, y, _ = centre
    return Box(
        (x - bin.width_m / 2, y - bin.length_m / 2, z_lower), (x + bin.width_m / 2, y + bin.length_m / 2, z_upper)
    )


def bin_interior(bin: BinConfig) -> Box:
    """Return the bin's interior, from floor to rim."""
    return _over_floor(BIN_CENTRE_M, bin, 0.0, bin.depth_m)


def bin_zone(bin: BinConfig) -> Box:
    """Return where a part's centre lies while the part counts as in the bin: the interior and some headroom."""
    return _over_floor(BIN_CENTRE_M, bin, -0.01, bin.depth_m + PILE_HEADROOM_M)


def chute_zone() -> Box:
    """Return where a part's centre lies once the part has been delivered."""
    return _over_floor(CHUTE_CENTRE_M, CHUTE, -0.01, CHUTE.depth_m)


def tcp_workspace(bin: BinConfig) -> Box:
    """Return where the TCP may be while it picks: over the bin's floor, up to 0.35 m."""
    return _over_floor(BIN_CENTRE_M, bin, 0.0, 0.35)
