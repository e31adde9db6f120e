"""Spaces of `BinServoEnv`: one table each makes the space and its documentation; and the meaning of an action."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from gymnasium import spaces
from jaxtyping import Float

from simpick.assets.grippers import get_gripper
from simpick.assets.grippers.servos import OPENING_SPEED_M_S
from simpick.envs.actions import finite_values
from simpick.envs.spaces import FAR_M, ActionItem, ObservationItem
from simpick.errors import ConfigError
from simpick.scene import SceneConfig
from simpick.scene.config import MAX_PARTS, CameraConfig
from simpick.scene.workspace import Box

MAX_LINEAR_SPEED_M_S = 0.25
"""TCP speed along each world axis at full command: the limit of ISO 10218-1 for moving a robot by hand control."""
MAX_ANGULAR_SPEED_RAD_S = np.deg2rad(90.0)
"""Speed about each world axis at full command."""
_TWIST_AT_1 = np.repeat([MAX_LINEAR_SPEED_M_S, MAX_ANGULAR_SPEED_RAD_S], 3)
SERVO_WORKSPACE = Box((0.14, -0.60, 0.0), (0.72, 0.28, 0.50))
"""Where the TCP's position is kept: over bin and chute, away from the arm's own base and the ends of its reach."""
JOINTS = 6
"""Of the arm."""
MAX_JOINT_RAD = 6.5
"""Bound of observed joint positions: the arm's range of two pi, plus a margin for the compliance of its stops."""
MAX_JOINT_SPEED_RAD_S = 10.0
"""Bound of observed joint speeds, three times the arm's limit."""

ACTION_TABLE = (
    ActionItem(
        "0-2",
        "linear velocity of the TCP along world x, y, z",
        f"{-MAX_LINEAR_SPEED_M_S}",
        f"{MAX_LINEAR_SPEED_M_S}",
        "m/s",
    ),
    ActionItem(
        "3-5",
        "angular velocity about world x, y, z through the TCP",
        f"{-MAX_ANGULAR_SPEED_RAD_S:.4f}",
        f"{MAX_ANGULAR_SPEED_RAD_S:.4f}",
        "rad/s",
    ),
    ActionItem(
        "6",
        "gripper: > 0 closes or switches the vacuum on, < 0 opens or off, 0 holds",
        f"{-OPENING_SPEED_M_S}",
        f"{OPENING_SPEED_M_S}",
        "m/s",
    ),
)
"""Elements of an action of `BinServoEnv`. An action of zeros holds arm and gripper."""

_CAMERA_MEANING = {"overhead": "image from above the bin", "wrist": "image from the camera on the hand"}
IMAGES = tuple(_CAMERA_MEANING)
"""Cameras that an observation may hold."""


@dataclass(frozen=True, eq=False)
class ServoCommand:
    """An action in SI units."""

    twist_world: Float[np.ndarray, "6"]
    """Linear velocity (m/s) of the TCP, then angular velocity (rad/s) about it, both in world axes."""
    gripper_rate: float
    """In [-1, 1]; positive closes."""


def decode_servo_action(action: np.ndarray | Sequence[float]) -> ServoCommand:
    """Return what an action commands; values beyond 1 are cut off.

    Raises:
        ConfigError: the action is not seven finite numbers.
    """
    values = finite_values(action, 7)
    return ServoCommand(values[:6] * _TWIST_AT_1, float(values[6]))


def servo_action_space() -> spaces.Box:
    """Return the action space; see `ACTION_TABLE`."""
    return spaces.Box(-1.0, 1.0, (7,), np.float32)


def servo_observation_table(config: SceneConfig, images: Sequence[str]) -> tuple[ObservationItem, ...]:
    """Return the rows for a scene's gripper and for these cameras at the scene's image sizes."""
    cameras: dict[str, CameraConfig] = {"overhead": config.overhead, "wrist": config.wrist}
    seen = [
        ObservationItem(
            name,
            _CAMERA_MEANING[name],
            "",
            spaces.Box(0, 255, (cameras[name].height_px, cameras[name].width_px, 3), np.uint8),
        )
        for name in images
    ]
    sensor = get_gripper(config.gripper).sensor
    reading = spaces.MultiBinary(1) if sensor.upper is None else spaces.Box(0.0, sensor.upper, (1,), np.float32)
    return (
        *seen,
        ObservationItem(
            "joint_positions", "of the arm", "rad", spaces.Box(-MAX_JOINT_RAD, MAX_JOINT_RAD, (JOINTS,), np.float32)
        ),
        ObservationItem(
            "joint_velocities",
            "of the arm",
            "rad/s",
            spaces.Box(-MAX_JOINT_SPEED_RAD_S, MAX_JOINT_SPEED_RAD_S, (JOINTS,), np.float32),
        ),
        ObservationItem(
            "T_world_tcp", "pose of the tool's centre point", "m", spaces.Box(-FAR_M, FAR_M, (4, 4), np.float32)
        ),
        ObservationItem(sensor.key, sensor.meaning, sensor.unit, reading),
        ObservationItem("remaining", "parts still in the bin", "", spaces.Discrete(MAX_PARTS + 1)),
    )


def servo_observation_space(config: SceneConfig, images: Sequence[str]) -> spaces.Dict:
    """Return the observation space for a scene's gripper and these cameras."""
    return spaces.Dict({item.key: item.space for item in servo_observation_table(config, images)})


def servo_scene_config(
    parts: Sequence[str],
    count: int = 12,
    gripper: str = "jaw",
    randomization: str = "default",
    image_size: tuple[int, int] = (160, 120),
) -> SceneConfig:
    """Return a scene with images of `image_size` (width, height) pixels from overhead and wrist cameras."""
    if not (isinstance(image_size, (tuple, list)) and len(image_size) == 2):
        raise ConfigError(f"image_size must be (width, height) in pixels, got {image_size!r}")
    width, height = image_size
    default = SceneConfig(parts=tuple(parts))
    return SceneConfig(
        parts=tuple(parts),
        count=count,
        gripper=gripper,
        randomization=randomization,
        overhead=CameraConfig(width, height, default.overhead.fovy_deg),
        wrist=CameraConfig(width, height, default.wrist.fovy_deg),
    )
