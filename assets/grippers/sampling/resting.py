"""How a part comes to rest on a floor: the directions from which a gripper must approach."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import trimesh
from jaxtyping import Float

from simpick.assets.part import Part

_COVERED = 0.97
_MOST_POSES = 24
_LEAST_SHARE = 0.01
_SAME_COSINE = np.cos(np.radians(10.0))


@lru_cache(maxsize=64)
def stable_poses(part: Part) -> tuple[Float[np.ndarray, "poses 4 4"], Float[np.ndarray, "poses"]]:
    """Return the poses T_floor_part in which the convex hull, thrown at random, comes to rest, and their probabilities.

    The most likely is first (Goldberg 1999). It takes seconds for a hull of many faces, so it is kept for each part.
    """
    Ts, shares = trimesh.poses.compute_stable_poses(part.mesh, sigma=0.0, n_samples=1, threshold=0.0)
    return np.asarray(Ts, float).reshape(-1, 4, 4), np.asarray(shares, float)


@lru_cache(maxsize=64)
def resting_directions(part: Part) -> Float[np.ndarray, "directions 3"]:
    """Return the unit vectors of the part frame that point up after it came to rest, the most likely first.

    Those around which, within 10 degrees, less than one per cent of throws ends are left out.
    """
    Ts, shares = stable_poses(part)
    ups = Ts[:, 2, :3]
    return ups[(ups @ ups.T > _SAME_COSINE) @ shares > _LEAST_SHARE * shares.sum()]


def resting_floors(part: Part) -> Float[np.ndarray, "poses 4"]:
    """Return floor planes (n, d) in the part frame, most likely first: points p of the part fulfil n . p >= d.

    n points up. Poses that a symmetry of the part maps onto each other count once, as do those of a round side that
    differ by less than 10 degrees. The least likely three per cent of throws are left out.
    """
    Ts_world_part, shares = stable_poses(part)
    group = part.symmetries.transforms(24)[:, :3, :3]
    floors: list[Float[np.ndarray, "4"]] = []
    seen = np.zeros((0, 3))
    covered = 0.0
    for T, share in zip(Ts_world_part, shares, strict=True):
        up = T[2, :3]
        # Mirror poses have equal shares: their order must not depend on the last bit, so nothing is sorted here.
        if not (len(seen) and (seen @ up > _SAME_COSINE).any()):
            floors.append(np.append(up, float((part.mesh.vertices @ up).min())))
            seen = np.concatenate([seen, group @ up])
        covered += float(share)
        if covered > _COVERED * float(np.sum(shares)) or len(floors) == _MOST_POSES:
            break
    return np.stack(floors) if floors else np.zeros((0, 4))
