"""Poses solved from matched points."""

import pytest
import torch

from simpick.estimators.raypose.network.pose_maps import cell_centres
from simpick.estimators.raypose.network.pose_solver import SolvedPoses, residuals, solve_poses, support
from simpick.geometry.torch_rotations import random_rotations, rotation_angle, so3_exp

GRID = cell_centres(8).flatten(0, 1).expand(4, -1, -1)
HALF_TANGENT = torch.full((4,), 0.08)


def scene(seed: int = 0) -> tuple[torch.Tensor, SolvedPoses]:
    """Points that appear exactly at the cells' centres at a known pose of one view each."""
    g = torch.Generator().manual_seed(seed)
    R = random_rotations((4, 1), g)
    centre = 0.2 * torch.randn((4, 1, 2), generator=g)
    log_scale = torch.log(torch.tensor([[1.0], [1.3], [0.8], [1.6]]))
    z = 0.5 * torch.randn((4, GRID.shape[1]), generator=g)
    perspective = (1 + HALF_TANGENT[:, None] * z)[..., None]
    seen = torch.cat([GRID * perspective - centre, z[..., None]], dim=-1)
    points = torch.einsum("bji,bnj->bni", R[:, 0], seen) / log_scale.exp()[..., None]
    return points, SolvedPoses(R, centre, log_scale)


def off(truth: SolvedPoses, deg: float, seed: int = 1) -> SolvedPoses:
    g = torch.Generator().manual_seed(seed)
    axis = torch.nn.functional.normalize(torch.randn((4, 1, 3), generator=g), dim=-1)
    return SolvedPoses(so3_exp(axis * deg * torch.pi / 180) @ truth.R, truth.centre + 0.1, truth.log_scale - 0.1)


def error_deg(found: SolvedPoses, truth: SolvedPoses) -> torch.Tensor:
    return rotation_angle(found.R.mT @ truth.R).squeeze(1) * 180 / torch.pi


@pytest.mark.parametrize("deg", [5.0, 30.0, 50.0])
def test_exact_matches_give_the_exact_pose(deg) -> None:
    points, truth = scene()
    found = solve_poses(points, GRID, torch.ones(4, GRID.shape[1]), HALF_TANGENT, off(truth, deg), iterations=20)
    assert error_deg(found, truth).max() < 0.2
    torch.testing.assert_close(found.centre, truth.centre, atol=2e-3, rtol=0)
    torch.testing.assert_close(found.log_scale, truth.log_scale, atol=5e-3, rtol=0)
    assert residuals(points, GRID, HALF_TANGENT, found).abs().max() < 0.01


def test_a_quarter_of_wrong_matches_does_little() -> None:
    points, truth = scene()
    wrong = points.clone()
    wrong[:, ::4] = wrong[:, ::4].roll(1, dims=1)
    found = solve_poses(wrong, GRID, torch.ones(4, GRID.shape[1]), HALF_TANGENT, off(truth, 10.0), iterations=20)
    assert error_deg(found, truth).max() < 1.0


def test_what_is_not_trusted_does_nothing() -> None:
    points, truth = scene()
    weights = torch.ones(4, GRID.shape[1])
    weights[:, ::2] = 0.0
    wrong = torch.where(weights[..., None] > 0, points, points.flip(1))
    found = solve_poses(wrong, GRID, weights, HALF_TANGENT, off(truth, 10.0), iterations=20)
    assert error_deg(found, truth).max() < 0.2


def test_every_start_is_solved_by_itself() -> None:
    points, truth = scene()
    starts = [off(truth, 8.0, seed) for seed in (1, 2)]
    both = SolvedPoses.stack(starts).map(lambda x: x[:, :, 0].transpose(0, 1))
    weights = torch.ones(4, GRID.shape[1])
    found = solve_poses(points, GRID, weights, HALF_TANGENT, both, iterations=3)
    for k, start in enumerate(starts):
        alone = solve_poses(points, GRID, weights, HALF_TANGENT, start, iterations=3)
        torch.testing.assert_close(found.R[:, k], alone.R[:, 0], atol=1e-5, rtol=0)


def test_nothing_seen_and_flat_parts_stay_finite() -> None:
    points, truth = scene()
    for sight in (points * torch.tensor([1.0, 1.0, 0.0]), torch.zeros_like(points)):
        found = solve_poses(sight, GRID, torch.ones(4, GRID.shape[1]), HALF_TANGENT, off(truth, 10.0))
        assert all(x.isfinite().all() for x in (found.R, found.centre, found.log_scale))
    found = solve_poses(points, GRID, torch.zeros(4, GRID.shape[1]), HALF_TANGENT, truth)
    torch.testing.assert_close(found.R, truth.R)


def test_the_gradient_is_that_of_the_solution() -> None:
    points, truth = scene()
    points.requires_grad_(True)
    weights = torch.ones(4, GRID.shape[1])
    found = solve_poses(points, GRID, weights, HALF_TANGENT, off(truth, 5.0), iterations=25)
    found.centre[0, 0, 0].backward()
    step = 1e-2 * torch.randn(points.shape, generator=torch.Generator().manual_seed(3))
    with torch.no_grad():
        ends = [
            solve_poses(points + sign * step, GRID, weights, HALF_TANGENT, truth, iterations=25).centre[0, 0, 0]
            for sign in (1, -1)
        ]
    expected = float(ends[0] - ends[1]) / 2
    assert points.grad is not None
    assert float((points.grad * step).sum()) == pytest.approx(expected, rel=0.15)


def test_support_is_highest_at_the_truth() -> None:
    points, truth = scene()
    ones = torch.ones(4, GRID.shape[1])
    at_truth = support(points, GRID, ones, ones, HALF_TANGENT, truth)
    torch.testing.assert_close(at_truth, torch.ones(4, 1), atol=1e-3, rtol=0)
    assert (support(points, GRID, ones, ones, HALF_TANGENT, off(truth, 20.0)) < 0.8 * at_truth).all()
