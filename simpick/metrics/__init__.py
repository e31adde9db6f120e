"""Evaluation: pose errors and scores as BOP defines them, and summaries of them.

The names below load their modules on first use, so that the command line may read this package's configs without
paying for scipy and trimesh.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from simpick.metrics.matching import count_targets as count_targets
    from simpick.metrics.matching import greedy_matches as greedy_matches
    from simpick.metrics.matching import top_estimates as top_estimates
    from simpick.metrics.matching import valid_truths as valid_truths
    from simpick.metrics.models import EvaluationModel as EvaluationModel
    from simpick.metrics.pose_errors import add as add
    from simpick.metrics.pose_errors import add_s as add_s
    from simpick.metrics.pose_errors import batch_pose_errors as batch_pose_errors
    from simpick.metrics.pose_errors import mspd as mspd
    from simpick.metrics.pose_errors import mssd as mssd
    from simpick.metrics.pose_errors import pose_error as pose_error
    from simpick.metrics.scores import AverageRecalls as AverageRecalls
    from simpick.metrics.scores import DepthImages as DepthImages
    from simpick.metrics.scores import PoseScores as PoseScores
    from simpick.metrics.scores import TargetErrors as TargetErrors
    from simpick.metrics.scores import average_recalls as average_recalls
    from simpick.metrics.scores import pose_scores as pose_scores
    from simpick.metrics.scores import target_errors as target_errors
    from simpick.metrics.summaries import PoseSummary as PoseSummary
    from simpick.metrics.summaries import summarize as summarize
    from simpick.metrics.summaries import summarize_by_visibility as summarize_by_visibility
    from simpick.metrics.visible_surface import distance_from_depth as distance_from_depth
    from simpick.metrics.visible_surface import visible_mask as visible_mask
    from simpick.metrics.visible_surface import vsd as vsd

_NAMES = {
    "matching": ("count_targets", "greedy_matches", "top_estimates", "valid_truths"),
    "models": ("EvaluationModel",),
    "pose_errors": ("add", "add_s", "batch_pose_errors", "mspd", "mssd", "pose_error"),
    "scores": (
        "AverageRecalls",
        "DepthImages",
        "PoseScores",
        "TargetErrors",
        "average_recalls",
        "pose_scores",
        "target_errors",
    ),
    "summaries": ("PoseSummary", "summarize", "summarize_by_visibility"),
    "visible_surface": ("distance_from_depth", "visible_mask", "vsd"),
}
_MODULE_OF = {name: module for module, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> object:
    """Load the module of a public name."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
