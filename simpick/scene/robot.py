"""Mounting arm, gripper and wrist camera, and putting them into their rest pose."""

from __future__ import annotations

import mujoco
import numpy as np

from simpick.assets.grippers import Gripper, get_gripper
from simpick.assets.robots.registry import Robot
from simpick.geometry.transforms import matrix_from_quaternion, transform
from simpick.scene.cameras import add_wrist_camera
from simpick.scene.config import SceneConfig

ARM_PREFIX = "arm/"


def mount_robot(spec: mujoco.MjSpec, robot: Robot, config: SceneConfig) -> None:
    """Add the arm at the world's origin with gripper and wrist camera."""
    flange = robot.add(spec, prefix=ARM_PREFIX)
    get_gripper(config.gripper).add(spec, flange)
    T_body_flange = transform(matrix_from_quaternion(flange.quat), np.asarray(flange.pos))
    add_wrist_camera(flange.parent, T_body_flange, config.wrist)


def go_home(model: mujoco.MjModel, data: mujoco.MjData, robot: Robot, gripper: Gripper) -> None:
    """Put the arm at rest at home and the gripper open, at once (no simulation)."""
    for name, q in zip(robot.joint_names, robot.home_qpos, strict=True):
        joint = model.joint(ARM_PREFIX + name)
        data.qpos[joint.qposadr[0]] = q
        data.qvel[joint.dofadr[0]] = 0.0
        data.ctrl[model.actuator(ARM_PREFIX + name).id] = q
    gripper.reset(model, data, gripper.max_opening_m)
