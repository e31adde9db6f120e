"""Which parts sleep: waking them, and carrying their sleep from one `MjData` to another.

MuJoCo leaves trees at rest out of the step. It does not count this as state, though it decides what the next step
computes, so a state that must continue bit for bit has to include it.
"""

from __future__ import annotations

import mujoco
import numpy as np

_FIELDS = (
    "tree_asleep",
    "tree_awake",
    "body_awake",
    "body_awake_ind",
    "parent_awake_ind",
    "dof_awake_ind",
    "ntree_awake",
    "nbody_awake",
    "nparent_awake",
    "nv_awake",
    "qacc",
)


def wake_all(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Wake every part, which may have lost its support, and update everything that follows from positions."""
    # MuJoCo offers no call for it, but it wakes all when it computes with sleeping switched off.
    enabled = model.opt.enableflags
    model.opt.enableflags = enabled & ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    mujoco.mj_forward(model, data)
    model.opt.enableflags = enabled


def sleep_state(data: mujoco.MjData) -> dict[str, np.ndarray]:
    """Return copies of the arrays that define which parts sleep."""
    return {name: np.array(getattr(data, name)) for name in _FIELDS}


def restore_sleep_state(data: mujoco.MjData, state: dict[str, np.ndarray]) -> None:
    """Put parts to sleep as `state` says; the poses of sleeping parts must be up to date already."""
    for name in _FIELDS:
        value = getattr(data, name)
        if isinstance(value, np.ndarray):
            value[:] = state[name]
        else:
            setattr(data, name, int(state[name]))
