"""Removing parts: a parked part is welded to its own place, far from the cell, and sleeps.

A weld is part of the simulation's state (`eq_active`), so that parking never changes the model. The places lie
beyond the far clipping plane of every camera.
"""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float

from simpick.geometry.transforms import quaternion_from_matrix

_CORNER_M = (-40.0, -4.0, 1.0)
_SPACING_M = 1.0
_COLUMNS = 8


def parking_place(instance: int) -> Float[np.ndarray, "3"]:
    """Return where instance number `instance` is parked, in the world frame."""
    row, column = divmod(instance, _COLUMNS)
    return np.array(_CORNER_M) + _SPACING_M * np.array([row, column, 0])


def add_parking(spec: mujoco.MjSpec, body_name: str, instance: int) -> None:
    """Add the weld, at first inactive, that holds this part's body when parked."""
    weld = spec.add_equality(name=f"{body_name}/parked", type=mujoco.mjtEq.mjEQ_WELD, active=False)
    weld.objtype = mujoco.mjtObj.mjOBJ_BODY
    weld.name1, weld.name2 = "world", body_name
    # Anchor in the part's frame, then the part's position and orientation in the world, then the torque's weight.
    weld.data[:11] = [0, 0, 0, *parking_place(instance), 1, 0, 0, 0, 1]


def park(model: mujoco.MjModel, data: mujoco.MjData, body_name: str, instance: int) -> None:
    """Move a part to its parking place and hold it there; call `wake_all` once all moves are made."""
    _place(data, body_name, np.array([*parking_place(instance), 1.0, 0.0, 0.0, 0.0]))
    data.eq_active[model.equality(f"{body_name}/parked").id] = 1


def release(model: mujoco.MjModel, data: mujoco.MjData, body_name: str, T_world_part: Float[np.ndarray, "4 4"]) -> None:
    """Free a part and put it, at rest, at this pose; call `wake_all` once all moves are made."""
    data.eq_active[model.equality(f"{body_name}/parked").id] = 0
    _place(data, body_name, np.array([*T_world_part[:3, 3], *quaternion_from_matrix(T_world_part[:3, :3])]))


def _place(data: mujoco.MjData, body_name: str, qpos: Float[np.ndarray, "7"]) -> None:
    joint = data.joint(body_name)
    joint.qpos[:] = qpos
    joint.qvel[:] = 0.0
    joint.qacc_warmstart[:] = 0.0
