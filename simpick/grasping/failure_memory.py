"""Failed attempts in a bin, which are not repeated while nothing has changed."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from simpick.assets.grippers.sampling.selection import HALF_TURN_Z, pose_distance
from simpick.assets.part import Part
from simpick.geometry.transforms import transform_points

_SAME_PLACE_M = (0.006, 0.015)
_SAME_PLACE_SHARE = 0.3
"""Two estimates of one part differ by less than this share of its diameter, within the bounds above."""
_SAME_POSE_RAD = np.radians(15.0)
_SAME_GRASP_M = 0.015
_TARGET_FACTOR = 0.02
_REPEAT_FACTOR = 0.002
_SURROUNDINGS_PX = 8
_CHANGED_LEVELS = 12.0
_CHANGED_SHARE = 0.03


@dataclass(frozen=True, eq=False)
class View:
    """What the image showed of a part and its surroundings."""

    luminance: Float32[np.ndarray, "height width"]
    region: Bool[np.ndarray, "height width"]

    @staticmethod
    def of(rgb: UInt8[np.ndarray, "height width 3"], outline: Bool[np.ndarray, "height width"]) -> View:
        """Return the view of the part that covers `outline`, with 8 px around it."""
        grown = cv2.dilate(outline.astype(np.uint8), np.ones((2 * _SURROUNDINGS_PX + 1,) * 2, np.uint8))
        return View(_luminance(rgb), grown.astype(bool))

    def differs_from(self, rgb: UInt8[np.ndarray, "height width 3"]) -> bool:
        """Return whether a later image shows something else here: 3 % of the region differ by 12 grey levels."""
        change = np.abs(_luminance(rgb) - self.luminance)[self.region]
        return bool(change.size and (change > _CHANGED_LEVELS).mean() > _CHANGED_SHARE)


@dataclass(eq=False)
class _Attempt:
    part: str
    place_m: Float[np.ndarray, "3"]
    T_world_part: Float[np.ndarray, "4 4"]
    T_world_tcp: Float[np.ndarray, "4 4"]
    missed: bool
    view: View | None
    changed: bool = False
    """Whether the image has since changed here."""


@dataclass
class FailureMemory:
    """Failed attempts of one episode.

    An attempt no longer counts once its part has moved: the same grasp may work on another pose. Parts are
    recognised by name and by the place of their centroid, since instances of one part cannot be distinguished, and
    neither a symmetric nor a mistaken flip from one image to the next moves the centroid far. Grasps are compared in
    the world for the same reason.

    While the image shows no change around the part, a grasp that failed is ruled out; where the gripper closed on
    nothing, so is the pose, which must be wrong. Afterwards both are only the last choice.
    """

    _attempts: list[_Attempt] = field(default_factory=list)

    def remember(
        self,
        part: Part,
        T_world_part: Float[np.ndarray, "4 4"],
        T_world_tcp: Float[np.ndarray, "4 4"],
        *,
        missed: bool = False,
        view: View | None = None,
    ) -> None:
        """Note that gripping `part`, estimated at `T_world_part`, at `T_world_tcp` has failed.

        `missed` says that the gripper closed on nothing, `view` what the image showed before.
        """
        place_m = _place(part, T_world_part)
        self._attempts.append(_Attempt(part.name, place_m, T_world_part.copy(), T_world_tcp.copy(), missed, view))

    def look(self, rgb: UInt8[np.ndarray, "height width 3"]) -> None:
        """Compare a new image with what each attempt's surroundings looked like before it."""
        for attempt in self._attempts:
            attempt.changed |= attempt.view is not None and attempt.view.differs_from(rgb)

    def forget(self) -> None:
        """Forget everything: a new episode."""
        self._attempts.clear()

    def __len__(self) -> int:
        return len(self._attempts)

    def factors(
        self, part: Part, T_world_part: Float[np.ndarray, "4 4"], Ts_world_tcp: Float[np.ndarray, "n 4 4"]
    ) -> Float[np.ndarray, "n"]:
        """Return in [0, 1] the remaining worth of each grasp of this part; 0 for one that is ruled out.

        Every failure on a part leaves its grasps a fiftieth, so that any other part with a free grasp comes first,
        and grasps like the failed one a tenth of that, or nothing while nothing has changed.
        """
        factors = np.ones(len(Ts_world_tcp))
        for attempt in self._at(part, T_world_part):
            alike = pose_distance(attempt.T_world_tcp, Ts_world_tcp, 0.02) < _SAME_GRASP_M
            alike |= pose_distance(attempt.T_world_tcp @ HALF_TURN_Z, Ts_world_tcp, 0.02) < _SAME_GRASP_M
            factors *= np.where(alike, _REPEAT_FACTOR if attempt.changed else 0.0, _TARGET_FACTOR)
        return factors if not self.is_ruled_out(part, T_world_part) else np.zeros(len(Ts_world_tcp))

    def is_ruled_out(self, part: Part, T_world_part: Float[np.ndarray, "4 4"]) -> bool:
        """Return whether the gripper has closed on nothing at this pose, and nothing has changed since."""
        return any(
            attempt.missed
            and not attempt.changed
            and part.symmetries.rotation_distance(T_world_part[:3, :3], attempt.T_world_part[:3, :3]) < _SAME_POSE_RAD
            for attempt in self._at(part, T_world_part)
        )

    def _at(self, part: Part, T_world_part: Float[np.ndarray, "4 4"]) -> list[_Attempt]:
        """Return the attempts at this part at about this place."""
        attempts = [a for a in self._attempts if a.part == part.name]
        if not attempts:
            return []
        tolerance_m = float(np.clip(_SAME_PLACE_SHARE * part.diameter_m, *_SAME_PLACE_M))
        place_m = _place(part, T_world_part)
        return [a for a in attempts if np.linalg.norm(a.place_m - place_m) <= tolerance_m]


def _place(part: Part, T_world_part: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "3"]:
    """Return where the part's centroid is, which every symmetry of the part leaves in place."""
    return transform_points(T_world_part, np.asarray(part.mesh.centroid, float)[None])[0]


def _luminance(rgb: UInt8[np.ndarray, "height width 3"]) -> Float32[np.ndarray, "height width"]:
    """Return the image in grey, smoothed by 3 px against noise."""
    return cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32), (3, 3), 0)
