"""Evaluation: pose errors and scores as BOP defines them, and summaries of them."""

from simpick.evaluation.matching import count_targets as count_targets
from simpick.evaluation.matching import greedy_matches as greedy_matches
from simpick.evaluation.matching import top_estimates as top_estimates
from simpick.evaluation.matching import valid_truths as valid_truths
from simpick.evaluation.models import EvaluationModel as EvaluationModel
from simpick.evaluation.pose_errors import add as add
from simpick.evaluation.pose_errors import add_s as add_s
from simpick.evaluation.pose_errors import mspd as mspd
from simpick.evaluation.pose_errors import mssd as mssd
from simpick.evaluation.pose_errors import pose_error as pose_error
from simpick.evaluation.pose_errors import pose_errors as pose_errors
from simpick.evaluation.scores import AverageRecalls as AverageRecalls
from simpick.evaluation.scores import DepthImages as DepthImages
from simpick.evaluation.scores import PoseScores as PoseScores
from simpick.evaluation.scores import TargetErrors as TargetErrors
from simpick.evaluation.scores import average_recalls as average_recalls
from simpick.evaluation.scores import pose_scores as pose_scores
from simpick.evaluation.scores import target_errors as target_errors
from simpick.evaluation.summaries import PoseSummary as PoseSummary
from simpick.evaluation.summaries import summarize as summarize
from simpick.evaluation.summaries import summarize_by_visibility as summarize_by_visibility
from simpick.evaluation.visible_surface import distance_from_depth as distance_from_depth
from simpick.evaluation.visible_surface import visible_mask as visible_mask
from simpick.evaluation.visible_surface import vsd as vsd
