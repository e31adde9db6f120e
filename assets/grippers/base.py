"""`Gripper`: what motion, grasp filters and verification need to know about any gripper.

Frames: the gripper's *base* sits on the arm's flange with +z pointing away from the arm; the TCP frame (site
``gripper/tcp``) has the same axes, shifted along +z, so +z approaches and the jaw closes along x. The TCP is rigid
with the base: neither finger motion nor the suction head's spring moves it.
"""

from __future__ import annotations

from typing import Literal, Protocol, TypeAlias, runtime_checkable

import mujoco
import numpy as np
from jaxtyping import Float

GripperBoxes: TypeAlias = Float[np.ndarray, "boxes 2 3"]
"""Lower and upper corners, in metres, of boxes aligned with the TCP frame that enclose the gripper's solids."""


@runtime_checkable
class Gripper(Protocol):
    """A gripper in a MuJoCo model: names, extent, and the commands that write its controls (or its contacts' adhesion).

    Every method takes model and data, so that one frozen record serves any number of scenes.
    """

    @property
    def kind(self) -> Literal["jaw", "suction"]:
        """Return which kind of `Grasp` this gripper executes."""
        ...

    @property
    def tcp_site(self) -> str:
        """Return the name of the TCP site."""
        ...

    @property
    def actuators(self) -> tuple[str, ...]:
        """Return the names of the actuators; none for suction."""
        ...

    @property
    def contact_geoms(self) -> tuple[str, ...]:
        """Return the geoms that hold a part: the rubber pads or the suction head's cells."""
        ...

    @property
    def T_base_tcp(self) -> Float[np.ndarray, "4 4"]:
        """Return the TCP frame in the gripper's base (flange) frame."""
        ...

    @property
    def max_opening_m(self) -> float:
        """Return the widest opening; 0 for suction."""
        ...

    @property
    def press_m(self) -> float:
        """Return how far past first contact the TCP should go to lay the suction face on; 0 for the jaw."""
        ...

    def boxes(self, opening_m: float) -> GripperBoxes:
        """Return boxes around the gripper's solids at this opening."""
        ...

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
        """Keep a commanded grip honest; call it at least every 20 ms: the vacuum follows the covered cells."""
        ...

    def opening_m(self, model: mujoco.MjModel, data: mujoco.MjData) -> float:
        """Return the distance between the pads now; 0 for suction."""
        ...

    def held_bodies(self, model: mujoco.MjModel, data: mujoco.MjData) -> tuple[int, ...]:
        """Return ids of the bodies that the gripper holds now: between both pads, or under the vacuum."""
        ...


def gripper_geoms(model: mujoco.MjModel, prefix: str) -> np.ndarray:
    """Return a mask over geom ids: those on bodies whose name starts with `prefix`."""
    bodies = np.array([(model.body(k).name or "").startswith(prefix) for k in range(model.nbody)])
    return bodies[model.geom_bodyid]


def parent_body(spec: mujoco.MjSpec, parent: mujoco.MjsSite | mujoco.MjsBody, name: str) -> mujoco.MjsBody:
    """Return a new body at `parent`: in a site's place and orientation, or at a body's origin."""
    if isinstance(parent, mujoco.MjsSite):
        body = parent.parent.add_body(name=name, pos=parent.pos)
        body.quat = parent.quat
        body.alt = parent.alt
    else:
        body = parent.add_body(name=name)
    body.gravcomp = 1
    return body
