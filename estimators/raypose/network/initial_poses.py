"""Initial poses: what matching, and then flow, conclude for each template's view. The decoder corrects them.

Not in the paper, whose decoder starts from noise alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from simpick.estimators.raypose.network.cell_subset import CellSubset
from simpick.estimators.raypose.network.consensus import consensus_pose
from simpick.estimators.raypose.network.flow import Flow, TemplateFlow
from simpick.estimators.raypose.network.matching import MIN_COVERAGE, Matcher, Matches
from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.estimators.raypose.network.pose_solver import ITERATIONS, SolvedPoses, residuals, solve_poses, support
from simpick.estimators.raypose.network.tokens import QueryTokens, TemplateTokens
from simpick.tensor_record import TensorRecord


@dataclass(frozen=True, eq=False)
class InitialPoses(TensorRecord):
    """What matches, and then flow, say of the pose."""

    matches: Matches
    solved: SolvedPoses
    """From matches, starting from each view's own pose."""
    flow: Flow | None
    """Around the consensus of these; None if the network measures none."""
    poses: SolvedPoses
    """The last answer, for each view."""

    def features(
        self, query: QueryTokens, reference: ViewPoses, diameter_m: Float[Tensor, "batch views"]
    ) -> Float[Tensor, "batch views cells features"]:
        """Return the decoder's input for each cell; see `Matches.features`."""
        r = residuals(self.matches.points, query.pixel_centroids, query.half_tangent, self.poses)
        scale = diameter_m / reference.half_extent_at_depth_m
        return self.matches.features(r, reference, scale, query.coverage, query.pixel_centroids)

    def support(self, query: QueryTokens, poses: SolvedPoses) -> Float[Tensor, "batch views"]:
        """Return the share of what is seen that is matched where each pose projects it, in [0, 1]."""
        # Not the learned trust, which is only relative.
        weights = query.coverage * self.matches.similarity.clamp(0, 1)
        points, half_tangent = self.matches.points, query.half_tangent
        return support(points, query.pixel_centroids, weights, query.coverage, half_tangent, poses)


def initial_poses(
    matcher: Matcher,
    flow: TemplateFlow | None,
    query: QueryTokens,
    templates: TemplateTokens,
    iterations: int = ITERATIONS,
    *,
    covered_only: bool = False,
) -> InitialPoses:
    """Return the initial poses; each query has one set of templates, which need not be fused.

    With `covered_only`, template cells beside the part are not matched, and query cells without weight solve nothing:
    the same poses in less time.
    """
    cells = [x.flatten(1, 2) for x in (templates.descriptors, templates.points, templates.coverage)]
    if covered_only:
        covered = CellSubset.of(cells[-1] >= MIN_COVERAGE)
        cells = [covered.take(x) for x in cells]
    descriptors, points, coverage = cells
    matches = matcher.match(query.descriptors, descriptors, points, coverage, query.coverage)
    start = SolvedPoses.of(templates.poses, templates.diameter_m)
    solved = _solve(matches, query, start, iterations, covered_only=covered_only)
    initial = InitialPoses(matches, solved, None, solved)
    return initial if flow is None else _measured(flow, query, templates, initial)


def follow_matches(
    flow: TemplateFlow | None, query: QueryTokens, templates: TemplateTokens, initial: InitialPoses, iterations: int
) -> InitialPoses:
    """Return initial poses that begin with those of matches alone, after some iterations; for answers, not for losses.

    Of the templates, poses and flow's cells are needed.
    """
    solved = _solve(initial.matches, query, initial.solved, iterations, covered_only=True)
    initial = InitialPoses(initial.matches, solved, None, solved)
    return initial if flow is None else _measured(flow, query, templates, initial)


def _solve(
    matches: Matches, query: QueryTokens, start: SolvedPoses, iterations: int, *, covered_only: bool
) -> SolvedPoses:
    cells = [matches.points, query.pixel_centroids, matches.weights]
    if covered_only:
        weighted = CellSubset.of(matches.weights > 0)
        cells = [weighted.take(x) for x in cells]
    points, observed, weights = cells
    return solve_poses(points, observed, weights, query.half_tangent, start, iterations)


def _measured(flow: TemplateFlow, query: QueryTokens, templates: TemplateTokens, initial: InitialPoses) -> InitialPoses:
    """Return the poses after flow around those of matches."""
    common = _consensus(initial.solved)
    nearer = templates.flow.nearer_half(templates.poses.R, common.R[:, 0])
    measured = flow(query.flow_descriptors, query.visible, nearer, query.half_tangent, common)
    views = initial.solved.R.shape[1]
    poses = measured.pose.map(lambda x: x.expand(-1, views, *x.shape[2:]))
    return InitialPoses(initial.matches, initial.solved, measured, poses)


def _consensus(solved: SolvedPoses) -> SolvedPoses:
    """Return the pose that most views agree on, as one view without gradient."""
    # In single precision, as they were solved. Extents are in diameters of the part.
    with torch.no_grad(), torch.autocast(solved.R.device.type, enabled=False):
        pose = consensus_pose(ViewPoses(solved.R, solved.centre, (-solved.log_scale).exp()))
        return SolvedPoses(pose.R, pose.centre, -pose.half_extent_at_depth_m.log()).map(lambda x: x[:, None])
