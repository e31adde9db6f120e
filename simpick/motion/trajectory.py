"""Trajectories in joint space: quintic time scaling along a straight joint segment or along a sampled path.

The time scaling s(u) = 10 u^3 - 15 u^4 + 6 u^5 starts and ends with zero speed and zero acceleration; its peak speed
is 15/8 and its peak acceleration 10/sqrt(3) (Lynch and Park, "Modern Robotics", 2017, section 9.2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

PEAK_SPEED = 15 / 8
"""Largest ds/du."""
PEAK_ACCELERATION = 10 / math.sqrt(3)
"""Largest magnitude of d2s/du2."""
_SAMPLES = 101


@runtime_checkable
class Trajectory(Protocol):
    """A motion from rest to rest."""

    @property
    def duration_s(self) -> float:
        """Return the time from start to end."""
        ...

    def states(
        self, times_s: Sequence[float]
    ) -> tuple[Float[np.ndarray, "times joints"], Float[np.ndarray, "times joints"]]:
        """Return positions (rad) and speeds (rad/s) at these times, clamped to the ends."""
        ...


def period_ends(duration_s: float, period_s: float) -> list[float]:
    """Return the ends of the control periods that cover a motion: the last is the first at or after its end."""
    times_s, t = [], 0.0
    while t < duration_s:
        t += period_s
        times_s.append(t)
    return times_s


def _scaled(times_s: Sequence[float], duration_s: float) -> Float[np.ndarray, "3 times 1"]:
    """Return s, ds/dt and whether the motion has not ended yet, at these times."""
    rows = []
    for t in times_s:
        if t < duration_s:
            s, ds, _ = quintic(max(t, 0.0) / duration_s)
            rows.append((s, ds / duration_s, 1.0))
        else:
            rows.append((1.0, 0.0, 0.0))
    return np.array(rows).reshape(-1, 3).T[..., None]


def quintic(u: float) -> tuple[float, float, float]:
    """Return s and its first two derivatives by u, at u in [0, 1]."""
    s = u**3 * (10 + u * (-15 + 6 * u))
    ds = 30 * u**2 * (1 - u) ** 2
    dds = 60 * u * (1 - u) * (1 - 2 * u)
    return s, ds, dds


@cache
def _samples() -> tuple[Float[np.ndarray, "u"], Float[np.ndarray, "u"], Float[np.ndarray, "u"]]:
    """Return s and its derivatives at evenly spaced u."""
    s, ds, dds = (np.array(column) for column in zip(*map(quintic, np.linspace(0, 1, _SAMPLES)), strict=True))
    return s, ds, dds


@dataclass(frozen=True, eq=False)
class JointSegment:
    """A straight line in joint space."""

    q_start: Float[np.ndarray, "joints"]
    q_end: Float[np.ndarray, "joints"]
    duration_s: float

    @staticmethod
    def within(
        q_start: Float[np.ndarray, "joints"],
        q_end: Float[np.ndarray, "joints"],
        speed_rad_s: float,
        acceleration_rad_s2: float,
    ) -> JointSegment:
        """Return the fastest segment whose joints keep both limits."""
        distance = float(np.abs(q_end - q_start).max())
        duration = max(
            PEAK_SPEED * distance / speed_rad_s, math.sqrt(PEAK_ACCELERATION * distance / acceleration_rad_s2)
        )
        return JointSegment(np.array(q_start, float), np.array(q_end, float), duration)

    def states(
        self, times_s: Sequence[float]
    ) -> tuple[Float[np.ndarray, "times joints"], Float[np.ndarray, "times joints"]]:
        """Return positions (rad) and speeds (rad/s) at these times, clamped to the ends."""
        s, ds, moving = _scaled(times_s, self.duration_s)
        step = self.q_end - self.q_start
        return np.where(moving, self.q_start + s * step, self.q_end), moving * (ds * step)


@dataclass(frozen=True, eq=False)
class PathTrajectory:
    """A cubic spline through joint vectors, run through with quintic time scaling."""

    spline: CubicSpline
    """Joint vector over the path's parameter in [0, 1]."""
    q_end: Float[np.ndarray, "joints"]
    duration_s: float

    @staticmethod
    def within(
        qs: Float[np.ndarray, "points joints"],
        arc_m: Float[np.ndarray, "points"],
        speed_rad_s: float,
        acceleration_rad_s2: float,
        tcp_speed_m_s: float,
    ) -> PathTrajectory:
        """Return the fastest pass through `qs` that keeps the limits.

        `arc_m` is the TCP's distance along its path at each point, strictly rising from 0.
        """
        length = float(arc_m[-1])
        spline = CubicSpline(arc_m / length, qs)
        s, ds, dds = _samples()
        slope, curvature = spline(s, 1), spline(s, 2)
        speed = np.abs(slope * ds[:, None]).max()
        acceleration = np.abs(curvature * ds[:, None] ** 2 + slope * dds[:, None]).max()
        # With duration T all speeds scale by 1/T and all accelerations by 1/T^2. The factor covers what lies
        # between the samples.
        duration = 1.01 * max(
            speed / speed_rad_s,
            math.sqrt(acceleration / acceleration_rad_s2),
            PEAK_SPEED * length / tcp_speed_m_s,
        )
        return PathTrajectory(spline, np.array(qs[-1], float), float(duration))

    def states(
        self, times_s: Sequence[float]
    ) -> tuple[Float[np.ndarray, "times joints"], Float[np.ndarray, "times joints"]]:
        """Return positions (rad) and speeds (rad/s) at these times, clamped to the ends."""
        s, ds, moving = _scaled(times_s, self.duration_s)
        along = s[:, 0]
        return np.where(moving, self.spline(along), self.q_end), moving * (ds * self.spline(along, 1))
