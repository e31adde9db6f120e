"""Names of a MuJoCo model's objects."""

from __future__ import annotations

import mujoco


def object_name(model: mujoco.MjModel, kind: mujoco.mjtObj, index: int) -> str:
    """Return an object's name, or kind and index (``geom_7``) for one without."""
    return mujoco.mj_id2name(model, kind, index) or f"{kind.name.removeprefix('mjOBJ_').lower()}_{index}"
