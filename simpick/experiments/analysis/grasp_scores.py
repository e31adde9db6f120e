"""Grasp scores: success rate, clearance, picks per hour, and how the rest failed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from simpick.experiments.result_store import EpisodeResult
from simpick.records import PickOutcome, PickRecord

PERCEPTION_STAGES = ("render", "detect", "estimate", "plan", "look")
"""Wall-clock stages that a robot would wait for; MPPH counts them beside the motion."""
ABSTENTIONS = (PickOutcome.NOTHING_DETECTED, PickOutcome.NO_GRASP)
"""Outcomes of picks that are no attempts: the policy sent no grasp to the arm."""


@dataclass(frozen=True)
class GraspScores:
    """Figures of a set of episodes. Those with a fault of the physics count in `outcomes` and nowhere else."""

    episodes: int
    attempts: int
    """Grasps that were sent to the arm, unreachable ones included."""
    abstentions: int
    """Picks in which nothing was detected or no grasp was left; no attempts, but they count as consecutive failures."""
    grasp_success: float
    """Share of attempts that delivered exactly one part, as in VGN (Volumetric Grasping Network)."""
    clearance: float
    """Share of the parts in the bins that were delivered."""
    cleared_episodes: float
    """Share of episodes that left the bin empty."""
    first_try_success: float
    """Share of parts targeted whose first attempt delivered; NaN where no attempt had a known target."""
    mpph: float
    """Mean picks per hour: 3600 x successes / (motion time + perception time)."""
    motion_s: float
    """Mean simulated time per attempt."""
    perception_s: float
    """Mean wall-clock time of rendering, detecting, estimating, planning and looking closer, per pick."""
    outcomes: dict[str, int]
    """Number of picks per outcome, most frequent first."""
    rotation_deg: float
    """Median rotation error of the estimates that were picked; NaN without any."""
    translation_mm: float
    """Median translation error of the estimates that were picked; NaN without any."""


def score_grasps(results: Iterable[EpisodeResult]) -> GraspScores:
    """Return the scores of these episodes, pooled over attempts."""
    results = list(results)
    valid = [r for r in results if r.ended != PickOutcome.SIMULATION_FAULT]
    picks = [pick for r in valid for pick in r.picks]
    attempts = [pick for pick in picks if pick.outcome not in ABSTENTIONS]
    successes = sum(pick.outcome is PickOutcome.SUCCESS for pick in attempts)
    motion_s = sum(pick.motion_s for pick in attempts)
    perception_s = sum(perception_time_s(pick) for pick in picks)
    parts = sum(len(r.instances) for r in valid)
    errors = [pick.pose_error for pick in attempts if pick.pose_error is not None]
    first_tries = [success for r in valid for success in first_try_successes(r)]
    outcomes = Counter(pick.outcome.value for r in results for pick in r.picks)
    return GraspScores(
        episodes=len(results),
        attempts=len(attempts),
        abstentions=len(picks) - len(attempts),
        grasp_success=successes / len(attempts) if attempts else float("nan"),
        clearance=sum(r.delivered for r in valid) / parts if parts else float("nan"),
        cleared_episodes=float(np.mean([r.ended == "cleared" for r in valid])) if valid else float("nan"),
        first_try_success=float(np.mean(first_tries)) if first_tries else float("nan"),
        mpph=3600 * successes / (motion_s + perception_s) if attempts else float("nan"),
        motion_s=motion_s / len(attempts) if attempts else float("nan"),
        perception_s=perception_s / len(picks) if picks else float("nan"),
        outcomes=dict(sorted(outcomes.items(), key=lambda item: (-item[1], item[0]))),
        rotation_deg=float(np.median([e.rotation_deg for e in errors])) if errors else float("nan"),
        translation_mm=float(np.median([e.translation_mm for e in errors])) if errors else float("nan"),
    )


def perception_time_s(pick: PickRecord) -> float:
    """Return the wall-clock time that the robot waited for perception and planning before this pick."""
    return sum(pick.timings_s.get(stage, 0.0) for stage in PERCEPTION_STAGES)


def first_try_successes(result: EpisodeResult) -> list[bool]:
    """Return for each instance that was ever targeted whether its first attempt succeeded."""
    first: dict[int, bool] = {}
    for pick in result.picks:
        if pick.target_instance is not None:
            first.setdefault(pick.target_instance, pick.outcome is PickOutcome.SUCCESS)
    return list(first.values())
