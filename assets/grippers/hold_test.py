"""`HoldTest`: what a grasp must endure in simulation before it is used."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class HoldTest:
    """Phases and limits of the test that `simpick.grasping.verification` runs. The defaults suit a jaw."""

    close_s: float = 0.22
    """Longest time to close and come to rest."""
    lift_s: float = 0.10
    """Lifting: gravity plus `lift_g` of acceleration."""
    lift_g: float = 0.4
    """Upward acceleration while lifting, in multiples of g."""
    shake_s: float = 0.24
    """Shaking sideways along x, then along y."""
    shake_g: float = 0.5
    """Amplitude of the shaking, in multiples of g."""
    shake_hz: float = 8.0
    """Frequency of the shaking."""
    tilt_s: float = 0.32
    """Tilting about x, then about y, to both sides."""
    tilt_deg: float = 50.0
    """Largest tilt: world grasps approach up to this far from the vertical."""
    slip_limit_m: float = 0.003
    """Largest motion of the part in the hand, at its centre of mass, after closing."""
    turn_limit_deg: float = 6.0
    """Largest rotation of the part in the hand after closing."""
    settle_limit_m: float = 0.008
    """Largest motion of the part while the gripper closes."""
    settle_limit_deg: float = 20.0
    """Largest rotation of the part while the gripper closes."""
    disturbance_m: float = 0.0015
    """A second trial displaces the grasp by this much, as an inexact pose would."""
    disturbance_deg: float = 3.0
    """And rotates it by this much."""
