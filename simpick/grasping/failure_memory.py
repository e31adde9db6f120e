"""What was tried in a bin and failed, so that it is not tried again while nothing has changed."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from simpick.grasping.selection import HALF_TURN_Z, pose_distance

_SAME_PLACE_M = 0.006
_SAME_GRASP_M = 0.012
_REPEAT_FACTOR = 0.05
_TARGET_FACTOR = 0.5


@dataclass
class FailureMemory:
    """Failed attempts of one episode.

    An attempt is forgotten as soon as its part has moved: the same grasp may work on another pose. Parts are
    recognised by name and place, since instances of one part cannot be told apart.
    """

    _attempts: list[tuple[str, Float[np.ndarray, "3"], Float[np.ndarray, "4 4"]]] = field(default_factory=list)

    def remember(
        self, part: str, T_world_part: Float[np.ndarray, "4 4"], T_world_tcp: Float[np.ndarray, "4 4"]
    ) -> None:
        """Note that gripping `part`, estimated at `T_world_part`, at `T_world_tcp` has failed."""
        self._attempts.append((part, T_world_part[:3, 3].copy(), T_world_tcp.copy()))

    def forget(self) -> None:
        """Forget everything: a new episode."""
        self._attempts.clear()

    def __len__(self) -> int:
        return len(self._attempts)

    def factors(
        self, part: str, T_world_part: Float[np.ndarray, "4 4"], Ts_world_tcp: Float[np.ndarray, "n 4 4"]
    ) -> Float[np.ndarray, "n"]:
        """Return in (0, 1] how much each grasp of this part is worth still.

        Every failure on a part halves all of its grasps, and grasps like the failed one keep a twentieth.
        """
        factors = np.ones(len(Ts_world_tcp))
        for name, place, T_world_failed in self._attempts:
            if name != part or np.linalg.norm(place - T_world_part[:3, 3]) > _SAME_PLACE_M:
                continue
            alike = pose_distance(T_world_failed, Ts_world_tcp, 0.02) < _SAME_GRASP_M
            alike |= pose_distance(T_world_failed @ HALF_TURN_Z, Ts_world_tcp, 0.02) < _SAME_GRASP_M
            factors *= np.where(alike, _REPEAT_FACTOR, _TARGET_FACTOR)
        return factors
