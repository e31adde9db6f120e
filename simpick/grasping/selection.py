"""Choosing a diverse few among many grasps, and repeating them over a part's symmetries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from simpick.geometry.symmetry import SymmetryGroup
from simpick.geometry.transforms import transform
from simpick.records import Grasp

HALF_TURN_Z = transform(np.diag([-1.0, -1.0, 1.0]))
"""Turning the TCP by 180 degrees about its approach swaps the fingers and changes nothing else."""


def pose_distance(
    T_a: Float[np.ndarray, "4 4"], Ts_b: Float[np.ndarray, "n 4 4"], lever_m: float
) -> Float[np.ndarray, "n"]:
    """Return distances in metres between one pose and many: translation plus rotation (rad) times `lever_m`."""
    offset = np.linalg.norm(Ts_b[:, :3, 3] - T_a[:3, 3], axis=-1)
    cosine = (np.einsum("ij,nij->n", T_a[:3, :3], Ts_b[:, :3, :3]) - 1) / 2
    return offset + lever_m * np.arccos(np.clip(cosine, -1, 1))


def diverse(
    grasps: Sequence[Grasp], symmetries: SymmetryGroup, *, count: int, spacing_m: float, lever_m: float = 0.02
) -> list[Grasp]:
    """Return up to `count` grasps, best first, none closer than `spacing_m` to another in `pose_distance`.

    Two grasps that a symmetry of the part or the jaw's half turn maps onto each other count as one. For suction,
    where the turn about the approach is free, poses are compared by position and approach alone.
    """
    order = sorted(range(len(grasps)), key=lambda k: -grasps[k].quality)
    if not order:
        return []
    group = symmetries.transforms(24)
    jaw = grasps[0].kind == "jaw"
    Ts = np.stack([grasps[k].T_part_tcp for k in order])
    free = np.ones(len(order), bool)
    kept: list[Grasp] = []
    for rank, k in enumerate(order):
        if not free[rank]:
            continue
        kept.append(grasps[k])
        if len(kept) == count:
            break
        for T in group @ grasps[k].T_part_tcp:
            if jaw:
                near = pose_distance(T, Ts, lever_m) < spacing_m
                near |= pose_distance(T @ HALF_TURN_Z, Ts, lever_m) < spacing_m
            else:
                tilt = np.arccos(np.clip(Ts[:, :3, 2] @ T[:3, 2], -1, 1))
                near = np.linalg.norm(Ts[:, :3, 3] - T[:3, 3], axis=-1) + lever_m * tilt < spacing_m
            free &= ~near
    return kept


def merged(pools: Sequence[Sequence[Grasp]], symmetries: SymmetryGroup, *, count: int, spacing_m: float) -> list[Grasp]:
    """Return up to `count` diverse grasps, taken from the pools in turn so that each keeps its best."""
    longest = max((len(pool) for pool in pools), default=0)
    turn = [pool[k] for k in range(longest) for pool in pools if k < len(pool)]
    # `diverse` prefers by quality; here the order of turns is the preference.
    ranked = [replace(grasp, quality=-float(k)) for k, grasp in enumerate(turn)]
    chosen = diverse(ranked, symmetries, count=count, spacing_m=spacing_m)
    return [turn[round(-grasp.quality)] for grasp in chosen]


def expanded(grasps: Sequence[Grasp], symmetries: SymmetryGroup, steps: int = 12) -> list[Grasp]:
    """Return every grasp under every symmetry of the part; continuous axes are cut into `steps` rotations."""
    if symmetries.is_trivial:
        return list(grasps)
    group = symmetries.transforms(steps)
    return [Grasp(T @ g.T_part_tcp, g.width_m, g.kind, g.quality) for g in grasps for T in group]
