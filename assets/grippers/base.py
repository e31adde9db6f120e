"""`Gripper`: everything that simpick needs to know about a gripper. A new one implements it and gets a registry row.

Frames: the gripper's *base* is mounted on the arm's flange with +z pointing away from the arm. The TCP frame (site
``gripper/tcp``) has the same axes, shifted along +z: +z is the approach, and a jaw closes along x. The TCP is rigid
with the base: neither finger motion nor the suction head's spring moves it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, TypeAlias, runtime_checkable

import mujoco
import numpy as np
from jaxtyping import Float

from simpick.assets.grippers.hold_test import HoldTest
from simpick.assets.part import Part
from simpick.records import Grasp

GRIPPER_PREFIX = "gripper/"
"""Names of a gripper's bodies, geoms, joints and sites in a model begin with this; contacts are sorted by it."""

GripperBoxes: TypeAlias = Float[np.ndarray, "boxes 2 3"]
"""Lower and upper corners, in metres, of boxes aligned with the TCP frame."""


@dataclass(frozen=True)
class GripperSensor:
    """What a gripper's own sensor measures: one row of the observation table of `BinServoEnv`."""

    key: str
    """Key in the observation."""
    meaning: str
    unit: str
    upper: float | None
    """Largest reading, the smallest being 0; None for a binary sensor."""


@runtime_checkable
class GraspSampling(Protocol):
    """A method that samples grasps on a part's mesh: a frozen dataclass whose fields are its settings."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    def sample(self, part: Part) -> list[Grasp]:
        """Return diverse grasps that no simulation has verified yet, best first. Deterministic."""
        ...


@runtime_checkable
class GripperServo(Protocol):
    """Opens, closes and holds the gripper of one scene by a commanded rate, as a teleoperator's trigger does."""

    def command(self, rate: float, period_s: float) -> None:
        """Set the controls for one period of at most 20 ms; `rate` in [-1, 1]: > 0 closes, < 0 opens, 0 holds."""
        ...


@runtime_checkable
class Gripper(Protocol):
    """A kind of gripper: its model, extent, grasps, and the commands that write its controls.

    Commands and readings take model and data: a gripper has no state, so one object is enough for all scenes.
    """

    # -- the model ----------------------------------------------------------------------------------------------

    @property
    def name(self) -> str:
        """Return the name in the registry."""
        ...

    @property
    def tcp_site(self) -> str:
        """Return the name of the TCP site."""
        ...

    @property
    def contact_geoms(self) -> tuple[str, ...]:
        """Return the geoms that hold a part: the rubber pads or the suction head's cells."""
        ...

    @property
    def T_base_tcp(self) -> Float[np.ndarray, "4 4"]:
        """Return the TCP frame in the gripper's base (flange) frame."""
        ...

    def add(self, spec: mujoco.MjSpec, parent: mujoco.MjsSite | mujoco.MjsBody) -> None:
        """Add the gripper at `parent`: the flange's site, or any body for a floating gripper."""
        ...

    # -- grasps -------------------------------------------------------------------------------------------------

    @property
    def max_opening_m(self) -> float:
        """Return the largest opening; 0 for a gripper that has none."""
        ...

    @property
    def press_m(self) -> float:
        """Return how far past first contact the TCP is pressed on; 0 for a gripper that closes around the part."""
        ...

    @property
    def turn_symmetry(self) -> int:
        """Return the order of rotational symmetry about the approach; 0 where any turn makes the same grasp."""
        ...

    @property
    def sampling(self) -> GraspSampling:
        """Return the method that samples grasps for this gripper."""
        ...

    @property
    def hold_test(self) -> HoldTest:
        """Return what a sampled grasp must endure in simulation."""
        ...

    @property
    def loaded_acceleration(self) -> float:
        """Return the arm's acceleration with a part in the gripper, as a fraction of that without, in (0, 1]."""
        ...

    def boxes(self, opening_m: float) -> GripperBoxes:
        """Return boxes that enclose the gripper's solids at this opening."""
        ...

    def grip_boxes(self, opening_m: float) -> GripperBoxes:
        """Return boxes around what the gripper would take along when it closes from this opening; may be empty."""
        ...

    # -- commands -----------------------------------------------------------------------------------------------

    def reset(self, model: mujoco.MjModel, data: mujoco.MjData, opening_m: float) -> None:
        """Set joints and controls to rest, released at this opening, at once (no simulation)."""
        ...

    def release(self, model: mujoco.MjModel, data: mujoco.MjData, opening_m: float) -> None:
        """Command the jaw to this opening, or the vacuum off."""
        ...

    def grip(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Command the jaw to close with its full force, or the vacuum on (if anything covers it)."""
        ...

    def maintain(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Update a commanded grip; called at least every 20 ms: the vacuum follows the covered cells."""
        ...

    def servo(self, model: mujoco.MjModel, data: mujoco.MjData) -> GripperServo:
        """Return a servo for this model and data, which starts from the released gripper."""
        ...

    # -- readings -----------------------------------------------------------------------------------------------

    @property
    def sensor(self) -> GripperSensor:
        """Return what `sense` measures."""
        ...

    def sense(self, model: mujoco.MjModel, data: mujoco.MjData) -> float:
        """Return the sensor's reading; 0 or 1 for a binary sensor."""
        ...

    def opening_m(self, model: mujoco.MjModel, data: mujoco.MjData) -> float:
        """Return the present opening; 0 for a gripper that has none."""
        ...

    def held_bodies(self, model: mujoco.MjModel, data: mujoco.MjData) -> tuple[int, ...]:
        """Return ids of the movable bodies that the gripper holds now."""
        ...

    def empty_cause(self, model: mujoco.MjModel, data: mujoco.MjData) -> str:
        """Return in words how the gripper closed without holding a part: the cause of a missed pick."""
        ...


def parent_body(spec: mujoco.MjSpec, parent: mujoco.MjsSite | mujoco.MjsBody, name: str) -> mujoco.MjsBody:
    """Return a new body at `parent`: at a site's position and orientation, or at a body's origin."""
    if isinstance(parent, mujoco.MjsSite):
        body = parent.parent.add_body(name=name, pos=parent.pos)
        body.quat = parent.quat
        body.alt = parent.alt
    else:
        body = parent.add_body(name=name)
    body.gravcomp = 1
    return body
