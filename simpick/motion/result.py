"""`PickResult`: what happened during one pick."""

from __future__ import annotations

from dataclasses import dataclass

from simpick.records import PickOutcome


@dataclass(frozen=True)
class PickResult:
    """The truth about one pick, as the simulator knows it."""

    outcome: PickOutcome
    cause: str
    """Why, in words: the stage and what was noticed there."""
    stages: tuple[str, ...]
    """Stages begun, in order."""
    motion_s: float
    """Simulated time from leaving home to being back; 0 where the arm never left."""
    peak_force_n: float
    """Largest contact force on the jaw's pads or the suction face's cells."""
    delivered: tuple[int, ...]
    """Instances that came to lie in the chute; they have been removed from the scene."""
    ejected: tuple[int, ...]
    """Instances that left the bin and did not reach the chute."""
    gripped: tuple[int, ...]
    """Instances that the gripper held after closing."""
