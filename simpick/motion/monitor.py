"""What the arm can sense during a pick: forces on gripper and arm, lag of the joints, and what the gripper holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8

from simpick.assets.contact_forces import normal_forces
from simpick.motion.collision import describe_geom
from simpick.motion.config import MotionConfig
from simpick.scene import ContactGroup, Scene

_LOST_TICKS = 4
_ABOVE_ROUNDING = 1 + 1e-9
_ROBOT, _FIXED, _PART, _PAD = 1, 2, 4, 8
"""Bits that say what a geom is."""
_KIND_OF_GROUP = np.zeros(len(ContactGroup), np.uint8)
_KIND_OF_GROUP[[ContactGroup.ARM, ContactGroup.GRIPPER]] = _ROBOT
_KIND_OF_GROUP[[ContactGroup.TABLE, ContactGroup.BIN, ContactGroup.CHUTE]] = _FIXED
_KIND_OF_GROUP[ContactGroup.PART] = _PART


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
        self._pads = [scene.model.geom(name).id for name in scene.gripper.contact_geoms]
        self._kinds = np.take(_KIND_OF_GROUP, scene.group_of_geom)
        self._kinds[self._pads] |= _PAD
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
        selected, kinds = self._robot_contacts(geoms)
        if len(selected) == 0:
            return
        # A loop, for these are a dozen contacts: arrays cost more.
        fixed_n, fixed, part_n = -1.0, None, 0.0
        on_pads: dict[int, list[float]] = {pad: [] for pad in self._pads}
        forces = normal_forces(data, selected).tolist()
        for (first, second), kind, force in zip(
            geoms.take(selected, axis=0).tolist(), kinds.tolist(), forces, strict=True
        ):
            if kind & _FIXED and force > fixed_n:
                fixed_n, fixed = force, (first, second)
            if kind & _PART and force > part_n:
                part_n = force
            if kind & _PAD and force > 0:
                for geom in (first, second):
                    if geom in on_pads:
                        on_pads[geom].append(force)
        self.part_force_n = part_n
        if fixed is not None:
            self.fixed_force_n = fixed_n
            self._fixed_pair = fixed if self._kinds[fixed[1]] & _FIXED else fixed[::-1]
        for pressing in on_pads.values():
            # Python's sum differs from NumPy's by rounding alone, and few are a new peak.
            if _ABOVE_ROUNDING * sum(pressing) > self.peak_force_n:
                self.peak_force_n = max(self.peak_force_n, float(np.sum(pressing)))

    def _robot_contacts(
        self, geoms: Int[np.ndarray, "contacts 2"]
    ) -> tuple[Int[np.ndarray, "selected"], UInt8[np.ndarray, "selected"]]:
        """Return which contacts join arm or gripper with anything, and the kinds of both geoms of each."""
        # Bits and columns: this is asked in every period, and `any` along rows of two takes several times as long.
        both = self._kinds.take(geoms)
        kinds = both[:, 0] | both[:, 1]
        selected = (kinds & _ROBOT).nonzero()[0]
        return selected, kinds.take(selected)

    def obstruction(self, q: np.ndarray, q_commanded: np.ndarray, holding: bool) -> Obstruction | None:
        """Return what stops the arm now, or None; while `holding`, force on parts is the grip's own."""
        config = self._config
        if self.fixed_force_n > config.collision_force_n:
            first, second = (describe_geom(self._scene.model, g) for g in self._fixed_pair)
            return Obstruction(f"{first} pressed on {second} with {self.fixed_force_n:.0f} N")
        if not holding and self.part_force_n > config.blocked_force_n:
            return Obstruction(f"parts resisted with {self.part_force_n:.0f} N")
        lag = q - q_commanded
        # No joint lags by more than the norm of all.
        if lag.dot(lag) > config.stall_rad**2 and np.abs(lag).max() > config.stall_rad:
            joint = int(np.argmax(np.abs(lag)))
            return Obstruction(f"joint {joint + 1} lagged its command by {np.rad2deg(abs(lag[joint])):.1f} deg")
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
        selected, _ = self._robot_contacts(geoms)
        if len(selected) == 0:
            return ()
        pairs = geoms[selected]
        instances = self._scene.instance_of_geom[pairs]
        return tuple(int(k) for k in np.unique(instances[instances >= 0]))

    def lost(self, gripped: tuple[int, ...]) -> bool:
        """Return whether nothing of what was gripped has been held for several periods running."""
        self._without = self._without + 1 if set(gripped).isdisjoint(self.held()) else 0
        return self._without >= _LOST_TICKS

    def still(self, speed: float) -> bool:
        """Return whether every part of the scene is slower than `speed` (m/s at its rim)."""
        return bool((self.part_speeds() < speed).all())

    def part_speeds(self) -> Float[np.ndarray, "instances"]:
        """Return the speed of every part's rim, linear plus angular, in m/s."""
        qvel = self._scene.data.qvel[self._part_dofs]
        return np.linalg.norm(qvel[:, :3], axis=1) + self._radii_m * np.linalg.norm(qvel[:, 3:], axis=1)
