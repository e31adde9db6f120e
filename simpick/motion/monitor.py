"""What the arm can sense during a pick: forces on gripper and arm, lag of the joints, and what the gripper holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from simpick.assets.contact_forces import normal_forces
from simpick.motion.collision import describe_geom
from simpick.motion.config import MotionConfig
from simpick.scene import ContactGroup, Scene

_LOST_TICKS = 4


@dataclass(frozen=True)
class Obstruction:
    """Something blocks the arm."""

    cause: str
    """Description of the obstruction."""


class Monitor:
    """Reads the contacts of one scene; `look` is called once per control period."""

    def __init__(self, scene: Scene, config: MotionConfig) -> None:
        assert scene.gripper is not None
        self._scene, self._config, self._gripper = scene, config, scene.gripper
        groups = scene.group_of_geom
        self._is_robot = (groups == ContactGroup.ARM) | (groups == ContactGroup.GRIPPER)
        self._is_fixed = np.isin(groups, [ContactGroup.TABLE, ContactGroup.BIN, ContactGroup.CHUTE])
        self._is_part = groups == ContactGroup.PART
        self._pads = np.array([scene.model.geom(name).id for name in scene.gripper.contact_geoms])
        self._is_pad = np.zeros(scene.model.ngeom, bool)
        self._is_pad[self._pads] = True
        self._instance_of_body = {i.body_id: i.instance for i in scene.instances}
        self._part_dofs = np.array([i.dof_adr for i in scene.instances])[:, None] + np.arange(6)
        self._radii_m = np.array([i.part.diameter_m / 2 for i in scene.instances])
        self.peak_force_n = 0.0
        """Largest sum of normal forces on any one of the gripper's contact geoms, so far."""
        self.fixed_force_n = 0.0
        """Largest normal force between the robot and what never moves, now."""
        self.part_force_n = 0.0
        """Largest normal force between the robot and any part, now."""
        self._fixed_pair = (0, 0)
        self._without = 0

    def look(self) -> None:
        """Read the contacts of the last simulation step."""
        data = self._scene.data
        self.fixed_force_n = self.part_force_n = 0.0
        if data.ncon == 0:
            return
        geoms = data.contact.geom
        selected = self._robot_contacts(geoms)
        if len(selected) == 0:
            return
        pairs, forces = geoms[selected], normal_forces(data)[selected]
        on_fixed = self._is_fixed[pairs].any(axis=1)
        if on_fixed.any():
            k = int(np.argmax(np.where(on_fixed, forces, -1.0)))
            self.fixed_force_n = float(forces[k])
            self._fixed_pair = tuple(sorted((int(g) for g in pairs[k]), key=lambda g: bool(self._is_fixed[g])))
        on_part = self._is_part[pairs].any(axis=1)
        self.part_force_n = float(forces[on_part].max(initial=0.0))
        on_pad = self._is_pad[pairs].any(axis=1)
        if on_pad.any():
            for pad in self._pads:
                pressing = (pairs == pad).any(axis=1) & (forces > 0)
                self.peak_force_n = max(self.peak_force_n, float(forces[pressing].sum()))

    def _robot_contacts(self, geoms: Int[np.ndarray, "contacts 2"]) -> Int[np.ndarray, "selected"]:
        """Return which contacts join arm or gripper with anything."""
        return np.flatnonzero(np.take(self._is_robot, geoms).any(axis=1))

    def obstruction(self, q: np.ndarray, q_commanded: np.ndarray, holding: bool) -> Obstruction | None:
        """Return what stops the arm now, or None; while `holding`, force on parts is the grip's own."""
        config = self._config
        if self.fixed_force_n > config.collision_force_n:
            first, second = (describe_geom(self._scene.model, g) for g in self._fixed_pair)
            return Obstruction(f"{first} pressed on {second} with {self.fixed_force_n:.0f} N")
        if not holding and self.part_force_n > config.blocked_force_n:
            return Obstruction(f"parts resisted with {self.part_force_n:.0f} N")
        lag = np.abs(q - q_commanded)
        if lag.max() > config.stall_rad:
            joint = int(np.argmax(lag))
            return Obstruction(f"joint {joint + 1} lagged its command by {np.rad2deg(lag[joint]):.1f} deg")
        return None

    def held(self) -> tuple[int, ...]:
        """Return the instances that the gripper holds now."""
        bodies = self._gripper.held_bodies(self._scene.model, self._scene.data)
        return tuple(self._instance_of_body[b] for b in bodies if b in self._instance_of_body)

    def clinging(self) -> tuple[int, ...]:
        """Return the instances that touch arm or gripper anywhere."""
        data = self._scene.data
        if data.ncon == 0:
            return ()
        geoms = data.contact.geom
        selected = self._robot_contacts(geoms)
        if len(selected) == 0:
            return ()
        pairs = geoms[selected]
        instances = self._scene.instance_of_geom[pairs]
        return tuple(int(k) for k in np.unique(instances[instances >= 0]))

    def lost(self, gripped: tuple[int, ...]) -> bool:
        """Return whether nothing of what was gripped has been held for several periods running."""
        self._without = 0 if set(self.held()) & set(gripped) else self._without + 1
        return self._without >= _LOST_TICKS

    def still(self, speed: float) -> bool:
        """Return whether every part of the scene is slower than `speed` (m/s at its rim)."""
        return bool((self.part_speeds() < speed).all())

    def part_speeds(self) -> Float[np.ndarray, "instances"]:
        """Return the speed of every part's rim, linear plus angular, in m/s."""
        qvel = self._scene.data.qvel[self._part_dofs]
        return np.linalg.norm(qvel[:, :3], axis=1) + self._radii_m * np.linalg.norm(qvel[:, 3:], axis=1)
