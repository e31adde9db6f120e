"""The bin's floor as a bound of depth and tilt: no part reaches below it, and most parts rest on it.

The image shows a part's depth by its size alone: half a pixel of outline all around is about a centimetre. The outline
of a flat part hardly changes if it tilts by ten degrees. But a part on the floor mostly lies in a stable pose, on a
face of its hull. Where the camera's pose is known, the floor is the plane z = 0 of the world (see `simpick.geometry`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from simpick.assets.grippers.sampling.resting import resting_directions
from simpick.assets.part import Part
from simpick.geometry import invert
from simpick.grasping.resting import raised_onto_floor
from simpick.records import CameraFrame, PoseEstimate

_FARTHEST_M = 0.3
"""If most parts are farther from the plane z = 0 than this, it is not the floor that they lie on."""
_SCALE_M = 0.004
"""Height at which the pull of the floor is strongest."""
_BELOW_WEIGHT, _REST_WEIGHT = 20.0, 5.0
"""Costs at `_SCALE_M`, twice the latter's; those of images are sums over pixels, some tens."""
_FLAT_WEIGHT, _FLAT_DEG = 20.0, 10.0
"""Cost of resting on the floor in no stable pose, and the tilt out of the nearest one at which half of it is due."""
UNKNOWN_REST = 0.5
"""Stands for `Floor.rest` where no floor is known, or where the part may lean on others."""
_SOFTNESS_M = 0.001
"""Vertices this much higher than the lowest one weigh 1/e of it, so that faces come to rest and not their corners."""


@dataclass(frozen=True, eq=False)
class Floor:
    """The floor, with the camera above it."""

    T_world_camera: Float[np.ndarray, "4 4"]

    @staticmethod
    def below(
        frame: CameraFrame, parts: Sequence[Part], Ts_camera_part: Sequence[Float[np.ndarray, "4 4"]]
    ) -> Floor | None:
        """Return the floor below parts in these poses; None without parts, or if the frame does not say where it is.

        That is so if the camera's pose is unknown (the identity), below z = 0, or far from there with all parts.
        """
        T = frame.T_world_camera
        if not len(Ts_camera_part) or np.array_equal(T, np.eye(4)) or T[2, 3] <= 0:
            return None
        heights_m = [float((T @ T_camera_part)[2, 3]) for T_camera_part in Ts_camera_part]
        return None if np.median(np.abs(heights_m)) > _FARTHEST_M else Floor(T)

    def raised(self, part: Part, Ts_camera_part: Float[np.ndarray, "n 4 4"]) -> Float[np.ndarray, "n 4 4"]:
        """Return the poses, those below the floor moved towards the camera until they rest on it."""
        eye_m = self.T_world_camera[:3, 3]
        Ts = [raised_onto_floor(part, self.T_world_camera @ T, eye_m) for T in Ts_camera_part]
        return invert(self.T_world_camera) @ np.stack(Ts)

    @staticmethod
    def under(frame: CameraFrame, estimates: Sequence[PoseEstimate], parts: Mapping[str, Part]) -> list[PoseEstimate]:
        """Return the estimates with all hypotheses raised onto the floor, if the frame says where it is."""
        floor = Floor.below(frame, [parts[e.part] for e in estimates], [e.T_camera_part for e in estimates])
        return list(estimates) if floor is None else [floor._raised_estimate(e, parts[e.part]) for e in estimates]

    def _raised_estimate(self, estimate: PoseEstimate, part: Part) -> PoseEstimate:
        poses = [estimate.T_camera_part, *(h.T_camera_part for h in estimate.hypotheses)]
        best, *others = self.raised(part, np.stack(poses))
        hypotheses = tuple(replace(h, T_camera_part=T) for h, T in zip(estimate.hypotheses, others, strict=True))
        return replace(estimate, T_camera_part=best, hypotheses=hypotheses)

    def rest(self, part: Part, Ts_camera_part: Float[np.ndarray, "n 4 4"]) -> Float[np.ndarray, "n"]:
        """Return how far each pose is one in which the part rests on the floor: 1 if it is, 0 far above or tilted."""
        up = np.broadcast_to(self.T_world_camera[2, :3], (len(Ts_camera_part), 3))
        heights, _ = self._lowest(part, Ts_camera_part, up)
        tilts, _ = _tilts(part, Ts_camera_part, up)
        return 1 / ((1 + (heights / _SCALE_M) ** 2) * (1 + (tilts**2).sum(axis=1)))

    def equations(
        self, part: Part, Ts_crop_part: Float[np.ndarray, "n 4 4"], Rs_crop_camera: Float[np.ndarray, "n 3 3"]
    ) -> tuple[Float[Tensor, "n"], Float[Tensor, "n 6 6"], Float[Tensor, "n 6"]]:
        """Return cost, Hessian and gradient of the poses' heights and tilts, for the parameters of `alignment`.

        The cost is quadratic below the floor; above, parts that are nearly on it are drawn to it, and into a stable
        pose if they are nearly in one.
        """
        up = Rs_crop_camera @ self.T_world_camera[2, :3]
        origin = Ts_crop_part[:, :3, 3]
        heights, arm = self._lowest(part, Ts_crop_part, up)
        # A point at O + a moves by w x a, by Z0 (dx0, dy0, 0), and by O dzeta.
        along_sight = (origin * up).sum(axis=1, keepdims=True)
        J = np.concatenate([np.cross(arm, up), origin[:, 2:] * up[:, :2], along_sight], axis=1) / _SCALE_M
        r, is_below = heights / _SCALE_M, heights < 0
        tilt, J_tilt = _tilts(part, Ts_crop_part, up)
        low, flat = 1 / (1 + r * r), 1 / (1 + (tilt * tilt).sum(axis=1))
        cost = np.where(is_below, _BELOW_WEIGHT * r * r, _REST_WEIGHT * (1 - low)) + _FLAT_WEIGHT * (1 - low * flat)
        weight = np.where(is_below, _BELOW_WEIGHT, _REST_WEIGHT * low**2) + _FLAT_WEIGHT * flat * low**2
        H, g = weight[:, None, None] * J[:, :, None] * J[:, None, :], (weight * r)[:, None] * J
        weight = _FLAT_WEIGHT * low * flat**2
        H[:, :3, :3] += weight[:, None, None] * np.einsum("nki,nkj->nij", J_tilt, J_tilt)
        g[:, :3] += weight[:, None] * np.einsum("nki,nk->ni", J_tilt, tilt)
        return torch.from_numpy(cost).float(), torch.from_numpy(H).float(), torch.from_numpy(g).float()

    def _lowest(
        self, part: Part, Ts_eye_part: Float[np.ndarray, "n 4 4"], up: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"]]:
        """Return the height of the poses' lowest points, and where these are, from the part's origin.

        The eye's frame is the camera's, turned; `up` is the floor's normal in it.
        """
        arms = np.einsum("nij,vj->nvi", Ts_eye_part[:, :3, :3], np.asarray(part.mesh.convex_hull.vertices))
        heights = np.einsum("nvi,ni->nv", arms, up)
        weights = np.exp(-(heights - heights.min(axis=1, keepdims=True)) / _SOFTNESS_M)
        weights /= weights.sum(axis=1, keepdims=True)
        origin_height = (Ts_eye_part[:, :3, 3] * up).sum(axis=1) + self.T_world_camera[2, 3]
        return (weights * heights).sum(axis=1) + origin_height, np.einsum("nv,nvi->ni", weights, arms)


def _tilts(
    part: Part, Ts_eye_part: Float[np.ndarray, "n 4 4"], up: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
    """Return the tilts out of the nearest stable poses, in units of `_FLAT_DEG`, and their derivatives by rotation.

    A tilt points along the axis of the rotation that would undo it; its length is twice the tangent of half the angle.
    A part without stable poses has no tilt.
    """
    directions = resting_directions(part)
    if not len(directions):
        return np.zeros((len(up), 3)), np.zeros((len(up), 3, 3))
    nearest = np.argmax(np.einsum("nij,ni,kj->nk", Ts_eye_part[:, :3, :3], up, directions), axis=1)
    wanted = np.einsum("nij,nj->ni", Ts_eye_part[:, :3, :3], directions[nearest])
    cosine, axis = (wanted * up).sum(axis=1)[:, None, None], np.cross(wanted, up)
    divisor = np.maximum(1 + cosine, 1e-6)
    # A rotation w moves `wanted` by w x wanted, hence the cosine by w . axis.
    J = wanted[:, :, None] * up[:, None, :] - cosine * np.eye(3) - axis[:, :, None] * axis[:, None, :] / divisor
    scale = 2 / divisor / np.radians(_FLAT_DEG)
    return scale[:, 0] * axis, scale * J
