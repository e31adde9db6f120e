"""Outcome and cause of a pick, from what was noticed during it and where the parts ended."""

from __future__ import annotations

from dataclasses import dataclass, field

from simpick.records import PickOutcome


@dataclass
class Evidence:
    """Observations during one pick."""

    in_bin: tuple[int, ...]
    """Instances in the bin before."""
    in_chute: tuple[int, ...]
    """Instances in the chute before."""
    in_bin_after: tuple[int, ...] = ()
    in_chute_after: tuple[int, ...] = ()
    stages: list[str] = field(default_factory=list)
    """Stages started, in order."""
    unreachable: str | None = None
    """Why no motion to the grasp was found."""
    collision: str | None = None
    """What stopped the arm, and where."""
    nothing_gripped: str | None = None
    """How the gripper closed without a part."""
    gripped: tuple[int, ...] = ()
    """Instances held after closing."""
    lifted: tuple[int, ...] = ()
    """Instances that were out of the bin at the top of the lift."""
    lost_at: str | None = None
    """Stage at which everything gripped was lost."""
    lost_in_bin: bool = False
    """Whether it was then still inside the bin."""
    lost_height_m: float = 0.0
    """Height of the TCP at that moment."""
    stuck: tuple[int, ...] = ()
    """Instances that still stuck to the gripper at home."""
    fault: str | None = None
    """How the physics diverged."""


@dataclass(frozen=True)
class Verdict:
    """Outcome and cause of one pick."""

    outcome: PickOutcome
    cause: str
    delivered: tuple[int, ...]
    ejected: tuple[int, ...]


def judge(evidence: Evidence) -> Verdict:
    """Return the outcome, by where the parts ended, and its cause.

    Order of precedence: a diverged simulation; no motion to the grasp; more than one part carried away; a
    part that sticks to the gripper; parts pushed out, or into the chute; one delivered; collision; the gripped part
    lost; nothing gripped.
    """
    if evidence.fault is not None:
        return Verdict(PickOutcome.SIMULATION_FAULT, evidence.fault, (), ())
    if evidence.unreachable is not None:
        return Verdict(PickOutcome.UNREACHABLE, evidence.unreachable, (), ())
    delivered = tuple(k for k in evidence.in_chute_after if k not in evidence.in_chute)
    ejected = tuple(k for k in evidence.in_bin if k not in evidence.in_bin_after and k not in delivered)
    outcome, cause = _outcome(evidence, delivered, ejected)
    return Verdict(outcome, cause, delivered, ejected)


def _outcome(evidence: Evidence, delivered: tuple[int, ...], ejected: tuple[int, ...]) -> tuple[PickOutcome, str]:
    carried = tuple(k for k in ejected if k in evidence.lifted)
    if len(delivered) > 1:
        return PickOutcome.DOUBLE_PICK, f"{_names(delivered)} were delivered together"
    if delivered and carried:
        return PickOutcome.DOUBLE_PICK, f"{_names(carried)} came along with {_names(delivered)} and fell off"
    if evidence.stuck and not delivered:
        return (
            PickOutcome.EJECTED,
            f"{_names(evidence.stuck)} stuck to the gripper and was taken off{_because(evidence)}",
        )
    pushed = tuple(k for k in ejected if k not in evidence.gripped)
    if pushed:
        first = f"; {_names(delivered)} was delivered" if delivered else _because(evidence)
        return PickOutcome.EJECTED, f"{_names(pushed)} left the bin and did not reach the chute{first}"
    if delivered and not evidence.gripped:
        return PickOutcome.EJECTED, f"{_names(delivered)} was knocked into the chute without being gripped"
    if delivered:
        return PickOutcome.SUCCESS, f"{_names(delivered)} was delivered into the chute"
    if evidence.collision is not None:
        return PickOutcome.COLLISION, evidence.collision
    if evidence.lost_at is not None:
        where = f"at stage {evidence.lost_at} with the TCP {1000 * evidence.lost_height_m:.0f} mm over the floor"
        if evidence.lost_in_bin:
            return PickOutcome.SLIPPED, f"{_names(evidence.gripped)} slipped out of the gripper {where}"
        return PickOutcome.DROPPED, f"{_names(evidence.gripped)} fell out of the gripper {where}"
    if evidence.nothing_gripped is not None:
        return PickOutcome.MISSED, evidence.nothing_gripped
    # Held to the end and yet not in the chute: it fell beside it, or stuck to the gripper and fell on the way home.
    return PickOutcome.DROPPED, f"{_names(evidence.gripped)} was released over the chute but did not come to lie in it"


def _because(evidence: Evidence) -> str:
    for reason in (evidence.collision, evidence.nothing_gripped):
        if reason is not None:
            return f"; {reason}"
    return f"; the gripped part was lost at stage {evidence.lost_at}" if evidence.lost_at is not None else ""


def _names(instances: tuple[int, ...]) -> str:
    return " and ".join(f"part_{k:02d}" for k in instances)
