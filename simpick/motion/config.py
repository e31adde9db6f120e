"""`MotionConfig`: how fast the arm moves, and what counts as a collision, a stall or a loss."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from simpick.errors import ConfigError


@dataclass(frozen=True)
class MotionConfig:
    """Speeds, distances and thresholds of a pick. The defaults give a cycle of four to six seconds."""

    joint_speed_rad_s: float = np.deg2rad(160.0)
    """Limit of every joint's speed; the arm itself allows 180 degrees a second."""
    joint_acceleration_rad_s2: float = 9.0
    """Limit of every joint's acceleration."""
    tcp_speed_m_s: float = 0.5
    """Limit of the TCP's speed on straight lines."""
    jaw_loaded_fraction: float = 0.8
    """Acceleration with a part between the jaw's pads, as a fraction of the acceleration without."""
    suction_loaded_fraction: float = 0.4
    """The same for a part under the suction head: at 0.8, four of 29 parts peeled off on the way to the chute, at 0.4
    none of 24."""
    control_period_s: float = 0.01
    """Time between two commands to the servos, each followed by a look at contacts."""
    approach_m: float = 0.08
    """Length of the last part of the approach, along the tool's axis."""
    hover_height_m: float = 0.24
    """Lowest height of the TCP over the bin's floor before it descends."""
    lift_height_m: float = 0.30
    """Height of the TCP over the bin's floor at which it turns to the chute: a long part must clear the rim."""
    release_height_m: float = 0.20
    """Height of the TCP over the chute's floor where it lets go."""
    collision_force_n: float = 60.0
    """Contact with bin, chute or table above this force is a collision."""
    blocked_force_n: float = 40.0
    """Parts that resist the approach with more than this force block it."""
    near_goal_m: float = 0.004
    """A blocked approach that came this close to its goal grips all the same."""
    stall_rad: float = 0.04
    """A joint that lags its command by more than this is stalled."""
    look_limit_m: float = 0.04
    """A second look may move the grasp by this much at most, else the first stands."""
    look_limit_rad: float = np.deg2rad(40.0)
    """A second look may turn the grasp by this much at most, else the first stands."""
    suction_search_m: float = 0.008
    """How far beyond the commanded pose the suction head looks for the surface."""
    settle_s: float = 1.5
    """Longest wait for parts to come to rest after a pick; not counted as motion."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (np.isfinite(value) and value > 0):
                raise ConfigError(f"motion {field.name} must be positive and finite, got {value}")
        for name in ("jaw_loaded_fraction", "suction_loaded_fraction"):
            if getattr(self, name) > 1:
                raise ConfigError(f"motion {name} must be at most 1, got {getattr(self, name)}")
        if self.joint_speed_rad_s > np.pi + 1e-9:
            raise ConfigError(
                f"motion joint_speed_rad_s must be at most pi (180 degrees/s, the arm's limit), got"
                f" {self.joint_speed_rad_s}"
            )
