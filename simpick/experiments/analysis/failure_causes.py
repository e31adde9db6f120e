"""Causes of failure: each pick that did not deliver exactly one part is attributed to one stage, by fixed rules."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from simpick.experiments.result_store import EpisodeResult
from simpick.records import PickOutcome, PickRecord

TOLERATED_DEG, TOLERATED_MM = 10.0, 5.0
"""Pose errors up to these are not counted as a cause: grasping tolerates them nearly always (`simpick sweep`)."""
FLIP_DEG = 60.0
"""From this rotation error on, an estimate in the right place confuses two sides of a part."""
FLIP_LATERAL_MM = 10.0
"""Up to this lateral error an estimate is in the right place in the image; its depth may be wrong."""


class FailureCause(StrEnum):
    """The stage that a failure is attributed to."""

    DETECTION = "detection"
    """Nothing was detected, or the target was a detection that belongs to no part."""
    POSE = "pose"
    """The error of the estimate exceeded `TOLERATED_DEG` or `TOLERATED_MM`; or no grasp was left on the estimates,
    where the oracle found one in the same bin."""
    SYMMETRY_FLIP = "symmetry flip"
    """The estimate was in the right place in the image, with a rotation error of `FLIP_DEG` or more."""
    GRASP = "grasp"
    """The pose was good, but the grasp missed, slipped or took two parts; or no grasp was left."""
    MOTION = "motion"
    """The pose was good, but the arm could not get there or was stopped on the way."""
    PHYSICS = "physics"
    """The pose was good and the part was lost in the air, or other parts were pushed out; or the physics diverged."""


@dataclass(frozen=True)
class Failure:
    """A pick that did not deliver exactly one part."""

    mode: str
    episode: int
    pick: PickRecord
    cause: FailureCause
    oracle_delivered: bool | None
    """Whether the oracle delivered the part that this pick was aimed at, in the same bin; None if unknown."""


def count_causes(failures: Iterable[Failure]) -> dict[FailureCause, int]:
    """Return how many of these failures are attributed to each cause, zeros included."""
    counts = Counter(failure.cause for failure in failures)
    return {cause: counts[cause] for cause in FailureCause}


_CAUSE_OF_OUTCOME = {
    PickOutcome.MISSED: FailureCause.GRASP,
    PickOutcome.SLIPPED: FailureCause.GRASP,
    PickOutcome.DOUBLE_PICK: FailureCause.GRASP,
    PickOutcome.UNREACHABLE: FailureCause.MOTION,
    PickOutcome.COLLISION: FailureCause.MOTION,
    PickOutcome.DROPPED: FailureCause.PHYSICS,
    PickOutcome.EJECTED: FailureCause.PHYSICS,
}


def find_failures(results: Sequence[EpisodeResult], oracle: Sequence[EpisodeResult] = ()) -> list[Failure]:
    """Return the failures in these results; `oracle` holds the oracle's, of which the same bins count."""
    by_episode = {result.episode: result for result in oracle}
    failures = []
    for result in results:
        counterpart = by_episode.get(result.episode)
        delivered = 0
        for pick in result.picks:
            if pick.outcome is not PickOutcome.SUCCESS:
                cause = failure_cause(
                    pick, oracle_found_more=counterpart is not None and counterpart.delivered > delivered
                )
                failures.append(Failure(result.mode, result.episode, pick, cause, _oracle_delivered(pick, counterpart)))
            delivered += len(pick.delivered)
    return failures


def failure_cause(pick: PickRecord, *, oracle_found_more: bool = False) -> FailureCause:
    """Return the cause of a failed pick; the first rule that fits applies.

    1. The physics diverged: physics.
    2. Nothing was detected, or the target belongs to no part: detection.
    3. No grasp was left: pose if `oracle_found_more`, that is if the oracle delivered more parts from this bin than
       had been delivered here; else grasp.
    4. A rotation error of `FLIP_DEG` or more, in the right place in the image: symmetry flip.
    5. An error above `TOLERATED_DEG` or `TOLERATED_MM`: pose.
    6. Missed, slipped, double pick: grasp. Unreachable, collision: motion. Dropped, ejected: physics.
    """
    if pick.outcome is PickOutcome.SIMULATION_FAULT:
        return FailureCause.PHYSICS
    if pick.outcome is PickOutcome.NOTHING_DETECTED:
        return FailureCause.DETECTION
    if pick.outcome is PickOutcome.NO_GRASP:
        return FailureCause.POSE if oracle_found_more else FailureCause.GRASP
    error = pick.pose_error
    if pick.target_instance is None or error is None:
        return FailureCause.DETECTION
    if error.rotation_deg >= FLIP_DEG and error.lateral_mm <= FLIP_LATERAL_MM:
        return FailureCause.SYMMETRY_FLIP
    if error.rotation_deg > TOLERATED_DEG or error.translation_mm > TOLERATED_MM:
        return FailureCause.POSE
    return _CAUSE_OF_OUTCOME[pick.outcome]


def _oracle_delivered(pick: PickRecord, counterpart: EpisodeResult | None) -> bool | None:
    if counterpart is None or pick.target_instance is None:
        return None
    return any(pick.target_instance in other.delivered for other in counterpart.picks)
