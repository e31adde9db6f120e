"""The arms that a scene can be built with, by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from simpick.assets.robots import ur5e, ur5e_inverse
from simpick.errors import UnknownNameError


@dataclass(frozen=True, eq=False)
class Robot:
    """An arm: how it is built, where it rests, how it is commanded, and its inverse kinematics."""

    name: str
    add: Callable[..., mujoco.MjsSite]
    """``add(spec, prefix="arm/", position=(0, 0, 0))`` adds the arm and returns its flange's site."""
    joint_names: tuple[str, ...]
    """Joints from the base outwards, without prefix; the position actuators have the same names."""
    home_qpos: Float[np.ndarray, "joints"]
    """Rest pose in radians: out of the overhead camera's view of the bin."""
    servo_command: Callable[..., np.ndarray]
    """``servo_command(q, qd)`` gives the controls that follow a moving target without lag, also for many rows at
    once."""
    inverse: Callable[..., np.ndarray]
    """``inverse(T_base_flange, q_near)`` gives one joint vector per branch of solutions, each angle within pi of
    `q_near`'s: the starts of the numerical solver. Shape (branches, joints); no rows out of reach."""


ROBOTS: dict[str, Robot] = {
    "ur5e": Robot(
        name="ur5e",
        add=ur5e.add_ur5e,
        joint_names=ur5e.JOINT_NAMES,
        home_qpos=ur5e.HOME_QPOS,
        servo_command=ur5e.servo_command,
        inverse=ur5e_inverse.inverse,
    ),
}


def get_robot(name: str) -> Robot:
    """Return the arm of this name; raises UnknownNameError, which lists those that exist."""
    if name not in ROBOTS:
        raise UnknownNameError("robot", name, ROBOTS)
    return ROBOTS[name]
