"""Failed attempts in a bin, which are not repeated while nothing has changed."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from simpick.assets.grippers.sampling.selection import HALF_TURN_Z, pose_distance
from simpick.assets.part import Part
from simpick.geometry.transforms import transform_points

_SAME_PLACE_M = (0.006, 0.015)
_SAME_PLACE_SHARE = 0.3
"""Two estimates of one part differ by less than this share of its diameter, within the bounds above."""
_SAME_GRASP_M = 0.015
_TARGET_FACTOR = 0.02
_REPEAT_FACTOR = 0.002


@dataclass
class FailureMemory:
    """Failed attempts of one episode.

    An attempt no longer counts once its part has moved: the same grasp may work on another pose. Parts are
    recognised by name and by the place of their centroid, since instances of one part cannot be distinguished, and
    neither a symmetric nor a mistaken flip from one image to the next moves the centroid far. Grasps are compared in
    the world for the same reason.
    """

    _attempts: list[tuple[str, Float[np.ndarray, "3"], Float[np.ndarray, "4 4"]]] = field(default_factory=list)

    def remember(
        self, part: Part, T_world_part: Float[np.ndarray, "4 4"], T_world_tcp: Float[np.ndarray, "4 4"]
    ) -> None:
        """Note that gripping `part`, estimated at `T_world_part`, at `T_world_tcp` has failed."""
        self._attempts.append((part.name, _place(part, T_world_part), T_world_tcp.copy()))

    def forget(self) -> None:
        """Forget everything: a new episode."""
        self._attempts.clear()

    def __len__(self) -> int:
        return len(self._attempts)

    def factors(
        self, part: Part, T_world_part: Float[np.ndarray, "4 4"], Ts_world_tcp: Float[np.ndarray, "n 4 4"]
    ) -> Float[np.ndarray, "n"]:
        """Return in (0, 1] the remaining worth of each grasp of this part.

        Every failure on a part leaves its grasps a fiftieth, so that any other part with a free grasp comes first,
        and grasps like the failed one a tenth of that.
        """
        tolerance_m = float(np.clip(_SAME_PLACE_SHARE * part.diameter_m, *_SAME_PLACE_M))
        place_now = _place(part, T_world_part)
        factors = np.ones(len(Ts_world_tcp))
        for name, place, T_world_failed in self._attempts:
            if name != part.name or np.linalg.norm(place - place_now) > tolerance_m:
                continue
            alike = pose_distance(T_world_failed, Ts_world_tcp, 0.02) < _SAME_GRASP_M
            alike |= pose_distance(T_world_failed @ HALF_TURN_Z, Ts_world_tcp, 0.02) < _SAME_GRASP_M
            factors *= np.where(alike, _REPEAT_FACTOR, _TARGET_FACTOR)
        return factors


def _place(part: Part, T_world_part: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "3"]:
    """Return where the part's centroid is, which every symmetry of the part leaves in place."""
    return transform_points(T_world_part, np.asarray(part.mesh.centroid, float)[None])[0]
