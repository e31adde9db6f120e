"""Choosing a diverse few among many grasps, and repeating them over a part's symmetries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from simpick.geometry.symmetry import SymmetryGroup
from simpick.geometry.transforms import so3_exp, transform
from simpick.records import Grasp

HALF_TURN_Z = transform(np.diag([-1.0, -1.0, 1.0]))
"""Turning the TCP by 180 degrees about its approach swaps the fingers of a jaw."""


def pose_distance(
    T_a: Float[np.ndarray, "4 4"], Ts_b: Float[np.ndarray, "n 4 4"], lever_m: float
) -> Float[np.ndarray, "n"]:
    """Return distances in metres between one pose and many: translation plus rotation (rad) times `lever_m`."""
    offset = np.linalg.norm(Ts_b[:, :3, 3] - T_a[:3, 3], axis=-1)
    cosine = (np.einsum("ij,nij->n", T_a[:3, :3], Ts_b[:, :3, :3]) - 1) / 2
    return offset + lever_m * np.arccos(np.clip(cosine, -1, 1))


def turn_about_z(angle_rad: float) -> Float[np.ndarray, "4 4"]:
    """Return the transform that turns a TCP about its approach."""
    return transform(so3_exp(np.array([0.0, 0.0, angle_rad])))


def diverse(
    grasps: Sequence[Grasp],
    symmetries: SymmetryGroup,
    turn_symmetry: int,
    *,
    count: int,
    spacing_m: float,
    lever_m: float = 0.02,
) -> list[Grasp]:
    """Return up to `count` grasps, best first, none closer than `spacing_m` to another in `pose_distance`.

    Two grasps that a symmetry of the part or of the gripper (`Gripper.turn_symmetry`) maps onto each other count as
    one. Where any turn about the approach makes the same grasp, positions and approaches are compared.
    """
    order = sorted(range(len(grasps)), key=lambda k: -grasps[k].quality)
    if not order:
        return []
    group = symmetries.transforms(24)
    turns = [turn_about_z(2 * np.pi * k / turn_symmetry) for k in range(turn_symmetry)]
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
            if turns:
                near = [pose_distance(T @ turn, Ts, lever_m) < spacing_m for turn in turns]
                free &= ~np.any(near, axis=0)
            else:
                tilt = np.arccos(np.clip(Ts[:, :3, 2] @ T[:3, 2], -1, 1))
                free &= np.linalg.norm(Ts[:, :3, 3] - T[:3, 3], axis=-1) + lever_m * tilt >= spacing_m
    return kept


def merged(
    pools: Sequence[Sequence[Grasp]], symmetries: SymmetryGroup, turn_symmetry: int, *, count: int, spacing_m: float
) -> list[Grasp]:
    """Return up to `count` diverse grasps, taken from the pools in turn so that each keeps its best."""
    longest = max((len(pool) for pool in pools), default=0)
    turn = [pool[k] for k in range(longest) for pool in pools if k < len(pool)]
    # `diverse` prefers by quality; here the order of turns is the preference.
    ranked = [replace(grasp, quality=-float(k)) for k, grasp in enumerate(turn)]
    chosen = diverse(ranked, symmetries, turn_symmetry, count=count, spacing_m=spacing_m)
    return [turn[round(-grasp.quality)] for grasp in chosen]


def expanded(grasps: Sequence[Grasp], symmetries: SymmetryGroup, steps: int = 12) -> list[Grasp]:
    """Return every grasp under every symmetry of the part; continuous axes are cut into `steps` rotations."""
    if symmetries.is_trivial:
        return list(grasps)
    group = symmetries.transforms(steps)
    return [replace(g, T_part_tcp=T @ g.T_part_tcp) for g in grasps for T in group]
