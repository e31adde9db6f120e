"""Whether the arm, as posed, touches bin, chute, table or itself: geometry only, on a model without parts."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np
from jaxtyping import Float

from simpick.assets.grippers import get_gripper
from simpick.assets.robots.registry import Robot
from simpick.scene.composition import compose_settling
from simpick.scene.config import SceneConfig
from simpick.scene.robot import ARM_PREFIX, mount_robot

ALLOWED_OVERLAP_M = 0.0005
"""A plan may graze by this much, no more: the arm is stiff, and a millimetre of wall is a collision."""
_STEP_RAD = 0.04


class CellCollision:
    """Collision checks against everything in the cell that never moves."""

    def __init__(self, config: SceneConfig, robot: Robot) -> None:
        spec = compose_settling(config, ())
        mount_robot(spec, robot, config)
        for geom in spec.geoms:
            if geom.name.startswith(ARM_PREFIX) and geom.contype:
                # In the simulation the arm's links pass through each other; here they must not.
                geom.contype = geom.conaffinity = 3
        self.model = spec.compile()
        self.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        self._data = mujoco.MjData(self.model)
        self._gripper = get_gripper(config.gripper)
        self._adr = np.array([self.model.joint(ARM_PREFIX + name).qposadr[0] for name in robot.joint_names])

    def set_opening(self, opening_m: float) -> None:
        """Pose the gripper's fingers for the checks that follow."""
        self._gripper.reset(self.model, self._data, opening_m)

    def contact(self, q: Float[np.ndarray, "joints"]) -> str | None:
        """Return a description of the deepest overlap at joint angles `q`, or None if there is none."""
        self._data.qpos[self._adr] = q
        mujoco.mj_kinematics(self.model, self._data)
        mujoco.mj_collision(self.model, self._data)
        contact = self._data.contact
        if self._data.ncon == 0 or contact.dist.min() > -ALLOWED_OVERLAP_M:
            return None
        deepest = int(np.argmin(contact.dist))
        geoms = [int(g) for g in contact.geom[deepest]]
        # What moves is named first.
        geoms.sort(key=lambda g: self.model.body_weldid[self.model.geom_bodyid[g]] == 0)
        first, second = (describe_geom(self.model, g) for g in geoms)
        return f"{first} would run {-1000 * contact.dist[deepest]:.0f} mm into {second}"

    def path_contact(self, qs: Float[np.ndarray, "points joints"]) -> str | None:
        """Return a description of the first overlap along straight joint-space lines through `qs`, or None."""
        for q_start, q_end in itertools.pairwise(qs):
            steps = max(1, int(np.ceil(np.abs(q_end - q_start).max() / _STEP_RAD)))
            for k in range(steps):
                found = self.contact(q_start + (q_end - q_start) * k / steps)
                if found is not None:
                    return found
        return self.contact(qs[-1])


def describe_geom(model: mujoco.MjModel, geom: int) -> str:
    """Return a readable name of a geom: its body, or its own name where that is more specific."""
    body = model.body(model.geom_bodyid[geom]).name
    name = model.geom(geom).name
    return name if body in ("bin", "chute", "world") and name else body
