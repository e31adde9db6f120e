"""How hard the gripper presses on what it touches."""

from __future__ import annotations

import mujoco
import numpy as np

from simpick.recording.object_names import object_name


class ContactForce:
    """Sums contact forces between the gripper and everything that is not the gripper."""

    def __init__(self, model: mujoco.MjModel, gripper_prefix: str) -> None:
        self._model = model
        names = [object_name(model, mujoco.mjtObj.mjOBJ_BODY, body) for body in range(model.nbody)]
        of_gripper = np.array([name.startswith(gripper_prefix) for name in names])
        self._gripper_geom = of_gripper[model.geom_bodyid]
        self.exists = bool(self._gripper_geom.any())
        """Whether the model has geoms of such a gripper."""

    def newtons(self, data: mujoco.MjData) -> float:
        """Return the sum of the normal forces (N) at the gripper's contacts, as of the last step."""
        if not data.ncon:
            return 0.0
        pairs = data.contact.geom[: data.ncon]
        # Contacts with flexes carry no geom (-1) and are left out.
        touching = (self._gripper_geom[pairs].sum(axis=1) == 1) & (pairs >= 0).all(axis=1)
        force, total = np.zeros(6), 0.0
        for contact in np.flatnonzero(touching):
            mujoco.mj_contactForce(self._model, data, int(contact), force)
            total += abs(force[0])
        return total
