"""`SceneConfig`: everything that decides what a scene is, besides the seed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Interval, MinLen

from simpick.assets.grippers import get_gripper
from simpick.assets.robots.registry import get_robot
from simpick.config import Config
from simpick.errors import ConfigError, UnknownNameError
from simpick.scene.physics import PhysicsConfig
from simpick.scene.randomization import RANDOMIZATIONS

MAX_PARTS = 50
"""A bin holds at most this many parts."""


_METRES = "give metres, not millimetres"
_Side = Annotated[float, Interval(ge=0.05, le=1), _METRES]


@dataclass(frozen=True)
class BinConfig(Config):
    """The container that parts lie in, by its inner dimensions."""

    length_m: _Side = 0.40
    """Along world y."""
    width_m: _Side = 0.30
    """Along world x."""
    depth_m: _Side = 0.12
    """From the inner floor (z = 0) to the rim."""
    wall_m: Annotated[float, Interval(ge=0.002, le=0.05), _METRES] = 0.008
    """Thickness of walls and floor."""


@dataclass(frozen=True)
class CameraConfig(Config):
    """One camera's image."""

    width_px: Annotated[int, Interval(ge=16, le=4096)] = 640
    """Image width."""
    height_px: Annotated[int, Interval(ge=16, le=4096)] = 480
    """Image height."""
    fovy_deg: Annotated[float, Interval(ge=5, le=120)] = 28.0
    """Vertical field of view."""


@dataclass(frozen=True)
class SceneConfig(Config):
    """The contents of the cell. Together with a seed it determines a scene to the last bit."""

    parts: Annotated[tuple[str, ...], MinLen(1)] = ("hex_bolt",)
    """Names of library parts or paths to CAD files. One makes a homogeneous bin, several a mixed one, whose
    instances are drawn from them with equal chances."""
    count: Annotated[int, Interval(ge=1, le=MAX_PARTS)] = 12
    """Parts in the bin at the start, 1 to 50."""
    robot: str | None = "ur5e"
    """Name of the arm; None leaves the cell without arm, gripper and wrist camera, for data sets."""
    gripper: str = "jaw"
    """Name of the gripper that the arm carries."""
    bin: BinConfig = BinConfig()
    """The bin; its centre is fixed, see `workspace`."""
    overhead: CameraConfig = CameraConfig(640, 480, 28.0)
    """The camera above the bin that perception looks through."""
    overhead_height_m: float = 0.90
    """Of the overhead camera above the bin's floor."""
    wrist: CameraConfig = CameraConfig(640, 480, 58.0)
    """The camera on the hand."""
    overview: CameraConfig = CameraConfig(640, 480, 42.0)
    """The camera for display: arm, bin and chute."""
    randomization: str = "default"
    """Name of a preset in `randomization.RANDOMIZATIONS`: how much looks vary with the seed."""
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)
    """Integrator, solver and contact settings."""

    def _check_rules(self) -> None:
        if len(set(self.parts)) != len(self.parts):
            raise ConfigError(f"parts must be distinct, got {', '.join(self.parts)}; name each part once")
        if self.robot is not None:
            get_robot(self.robot)
        get_gripper(self.gripper)
        if self.randomization not in RANDOMIZATIONS:
            raise UnknownNameError("randomization preset", self.randomization, RANDOMIZATIONS)
        lowest = self.bin.depth_m + 0.3
        if not lowest <= self.overhead_height_m <= 3.0:
            raise ConfigError(
                f"overhead_height_m must be between {lowest:.2f} (0.3 m over the bin's rim) and 3.0 m,"
                f" got {self.overhead_height_m}"
            )
