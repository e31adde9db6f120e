"""`MotionConfig`: how fast the arm moves, and what counts as a collision, a stall or a loss."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Interval

from simpick.config import Config, PositiveFloat


@dataclass(frozen=True)
class MotionConfig(Config):
    """Speeds, distances and thresholds of a pick. The defaults give a cycle of four to six seconds."""

    joint_speed_rad_s: Annotated[float, Interval(gt=0, le=np.pi), "in radians per second"] = np.deg2rad(160.0)
    """Limit of every joint's speed; the arm itself allows 180 degrees per second."""
    joint_acceleration_rad_s2: PositiveFloat = 9.0
    """Limit of every joint's acceleration."""
    tcp_speed_m_s: PositiveFloat = 0.5
    """Limit of the TCP's speed on straight lines."""
    control_period_s: PositiveFloat = 0.01
    """Time between two commands to the servos, each followed by a reading of contacts."""
    approach_m: PositiveFloat = 0.08
    """Length of the last part of the approach, along the tool's axis."""
    hover_height_m: PositiveFloat = 0.24
    """Lowest height of the TCP over the bin's floor before it descends."""
    lift_height_m: PositiveFloat = 0.30
    """Height of the TCP over the bin's floor at which it turns to the chute: a long part must clear the rim."""
    release_height_m: PositiveFloat = 0.20
    """Height of the TCP over the chute's floor where it lets go."""
    collision_force_n: PositiveFloat = 60.0
    """Contact with bin, chute or table above this force is a collision."""
    blocked_force_n: PositiveFloat = 40.0
    """Parts that resist the approach with more than this force block it."""
    near_goal_m: PositiveFloat = 0.004
    """A blocked approach that came this close to its goal grips all the same."""
    stall_rad: PositiveFloat = 0.04
    """A joint that lags its command by more than this is stalled."""
    look_limit_m: PositiveFloat = 0.04
    """Largest translation of a grasp by a closer look; beyond it, the first grasp is kept."""
    look_limit_rad: PositiveFloat = np.deg2rad(40.0)
    """Largest rotation of a grasp by a closer look; beyond it, the first grasp is kept."""
    search_m: PositiveFloat = 0.008
    """How far beyond the commanded pose a gripper that is pressed on searches for the surface."""
    settle_s: PositiveFloat = 1.5
    """Longest wait for parts to come to rest after a pick; not counted as motion."""
