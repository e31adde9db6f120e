"""`SceneConfig`: everything that decides what a scene is, besides the seed."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Any

from simpick.assets.robots.registry import get_robot
from simpick.errors import ConfigError, UnknownNameError
from simpick.scene.physics import PhysicsConfig
from simpick.scene.randomization import RANDOMIZATIONS

MAX_PARTS = 50
"""A bin holds at most this many parts."""

GRIPPERS = ("jaw", "suction")
"""Grippers that an arm can carry."""


@dataclass(frozen=True)
class BinConfig:
    """The container that parts lie in, by its inner measures."""

    length_m: float = 0.40
    """Along world y."""
    width_m: float = 0.30
    """Along world x."""
    depth_m: float = 0.12
    """From the inner floor (z = 0) to the rim."""
    wall_m: float = 0.008
    """Thickness of walls and floor."""

    def __post_init__(self) -> None:
        for name in ("length_m", "width_m", "depth_m"):
            value = getattr(self, name)
            if not 0.05 <= value <= 1.0:
                raise ConfigError(
                    f"bin {name} must be between 0.05 and 1.0 m, got {value}; give metres, not millimetres"
                )
        if not 0.002 <= self.wall_m <= 0.05:
            raise ConfigError(f"bin wall_m must be between 0.002 and 0.05 m, got {self.wall_m}; give metres")


@dataclass(frozen=True)
class CameraConfig:
    """One camera's image."""

    width_px: int = 640
    """Image width."""
    height_px: int = 480
    """Image height."""
    fovy_deg: float = 28.0
    """Vertical field of view."""

    def __post_init__(self) -> None:
        for name in ("width_px", "height_px"):
            value = getattr(self, name)
            if not 16 <= value <= 4096:
                raise ConfigError(f"camera {name} must be between 16 and 4096, got {value}")
        if not 5.0 <= self.fovy_deg <= 120.0:
            raise ConfigError(f"camera fovy_deg must be between 5 and 120 degrees, got {self.fovy_deg}")


@dataclass(frozen=True)
class SceneConfig:
    """What stands in the cell. Together with a seed it determines a scene to the last bit."""

    parts: tuple[str, ...] = ("hex_bolt",)
    """Names of library parts or paths to CAD files. One makes a homogeneous bin, several a mixed one, whose
    instances are drawn from them with equal chances."""
    count: int = 12
    """Parts in the bin at the start, 1 to 50."""
    robot: str | None = "ur5e"
    """Name of the arm; None leaves the cell without arm, gripper and wrist camera, for data sets."""
    gripper: str = "jaw"
    """What the arm carries, one of `GRIPPERS`."""
    bin: BinConfig = BinConfig()
    """The bin; its centre is fixed, see `workspace`."""
    overhead: CameraConfig = CameraConfig(640, 480, 28.0)
    """The camera above the bin that perception looks through."""
    overhead_height_m: float = 0.90
    """Of the overhead camera above the bin's floor."""
    wrist: CameraConfig = CameraConfig(640, 480, 58.0)
    """The camera on the hand."""
    overview: CameraConfig = CameraConfig(640, 480, 42.0)
    """The camera for people: arm, bin and chute."""
    randomization: str = "default"
    """Name of a preset in `randomization.RANDOMIZATIONS`: how much looks vary with the seed."""
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)
    """Integrator, solver and contact settings."""

    def __post_init__(self) -> None:
        if isinstance(self.parts, str) or not self.parts:
            raise ConfigError(f"parts must be a tuple of one or more part names, got {self.parts!r}")
        if len(set(self.parts)) != len(self.parts):
            raise ConfigError(f"parts must be distinct, got {', '.join(self.parts)}; name each part once")
        if not 1 <= self.count <= MAX_PARTS:
            raise ConfigError(f"count must be between 1 and {MAX_PARTS} parts, got {self.count}")
        if self.robot is not None:
            get_robot(self.robot)
        if self.gripper not in GRIPPERS:
            raise UnknownNameError("gripper", self.gripper, GRIPPERS)
        if self.randomization not in RANDOMIZATIONS:
            raise UnknownNameError("randomization preset", self.randomization, RANDOMIZATIONS)
        lowest = self.bin.depth_m + 0.3
        if not (math.isfinite(self.overhead_height_m) and lowest <= self.overhead_height_m <= 3.0):
            raise ConfigError(
                f"overhead_height_m must be between {lowest:.2f} (0.3 m over the bin's rim) and 3.0 m,"
                f" got {self.overhead_height_m}"
            )

    def to_dict(self) -> dict[str, Any]:
        """Return plain values that `from_dict` and JSON understand."""
        return asdict(self)

    @staticmethod
    def from_dict(values: dict[str, Any]) -> SceneConfig:
        """Return the configuration that `to_dict` described; raises ConfigError on unknown keys."""
        values = dict(values)
        nested = {
            "bin": BinConfig,
            "overhead": CameraConfig,
            "wrist": CameraConfig,
            "overview": CameraConfig,
            "physics": PhysicsConfig,
        }
        try:
            for key, cls in nested.items():
                values[key] = cls(**values[key])
            values["parts"] = tuple(values["parts"])
            return SceneConfig(**values)
        except (KeyError, TypeError) as error:
            raise ConfigError(f"not a scene configuration of this version of simpick: {error}") from error
