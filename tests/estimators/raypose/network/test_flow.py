"""Flow between templates and query: what is read around expected places, and the pose that follows."""

import dataclasses

import pytest
import torch

from simpick.estimators.raypose.network.flow import FlowCells, TemplateFlow
from simpick.estimators.raypose.network.pose_solver import SolvedPoses, project, solve_poses
from simpick.geometry.torch_rotations import random_rotations, rotation_angle, so3_exp
from tests.estimators.raypose.networks import TINY

SIDE = TINY.flow_cells
CELLS = SIDE * SIDE
BATCH, VIEWS = 3, 2
HALF_TANGENT = torch.full((BATCH,), 0.06)


def flow_network(config=TINY) -> TemplateFlow:
    """Return a new network: it believes in what correlates, everywhere alike."""
    torch.manual_seed(0)
    network = TemplateFlow(config, fine_width=16).eval()
    with torch.no_grad():
        network.log_temperature.fill_(4.6)
    return network


def one_view(R: torch.Tensor, centre: torch.Tensor, log_scale: torch.Tensor) -> SolvedPoses:
    return SolvedPoses(R[:, None], centre[:, None], log_scale[:, None])


def scene(seed: int = 0) -> tuple[FlowCells, torch.Tensor, SolvedPoses]:
    """Points in relief, and descriptors that say where the query shows them: those of a smooth field."""
    g = torch.Generator().manual_seed(seed)
    truth = one_view(random_rotations((BATCH,), g), torch.zeros(BATCH, 2), torch.zeros(BATCH))
    x = 1.4 * (torch.rand((BATCH, VIEWS * CELLS, 2), generator=g) - 0.5)
    z = torch.rand((BATCH, VIEWS * CELLS, 1), generator=g) - 0.5
    points = torch.einsum("bji,bnj->bni", truth.R[:, 0], torch.cat([x, z], dim=-1))
    waves = 2.0 * torch.randn((2, TINY.flow_width // 2), generator=g)

    def field(places: torch.Tensor) -> torch.Tensor:
        angles = places @ waves
        return torch.nn.functional.normalize(torch.cat([angles.sin(), angles.cos()], dim=-1), dim=-1)

    axis = (torch.arange(SIDE) + 0.5) * 2 / SIDE - 1
    rows, columns = torch.meshgrid(axis, axis, indexing="ij")
    query = field(torch.stack([columns, rows], dim=-1).flatten(0, 1)).expand(BATCH, -1, -1)
    descriptors = field(project(points, HALF_TANGENT, truth)[0][:, 0])
    cells = FlowCells(
        descriptors.unflatten(1, (VIEWS, CELLS)), points.unflatten(1, (VIEWS, CELLS)), torch.ones(BATCH, VIEWS, CELLS)
    )
    return cells, query, truth


def off(truth: SolvedPoses, deg: float) -> SolvedPoses:
    turn = so3_exp(torch.tensor([0.6, -0.5, 0.62]) * deg * torch.pi / 180)
    return one_view(turn @ truth.R[:, 0], truth.centre[:, 0] + 0.03, truth.log_scale[:, 0] + 0.03)


def error_deg(pose: SolvedPoses, truth: SolvedPoses) -> torch.Tensor:
    return rotation_angle(pose.R.mT @ truth.R).flatten() * 180 / torch.pi


def test_what_looks_alike_moves_the_pose_towards_the_truth() -> None:
    cells, query, truth = scene()
    start = off(truth, 10.0)
    with torch.inference_mode():
        flow = flow_network()(query, torch.ones(BATCH, CELLS), cells, HALF_TANGENT, start)
    wanted = project(flow.points, HALF_TANGENT, truth)[0][:, 0] - flow.expected
    assert (flow.offset - wanted)[flow.valid].norm(dim=-1).mean() < 0.5 * wanted[flow.valid].norm(dim=-1).mean()
    assert (error_deg(flow.pose, truth) < 0.4 * error_deg(start, truth)).all()
    assert ((flow.pose.centre - truth.centre).norm(dim=-1) < 0.5 * (start.centre - truth.centre).norm(dim=-1)).all()


def test_what_is_not_covered_gives_no_residual() -> None:
    cells, query, truth = scene()
    start, network = off(truth, 6.0), flow_network()
    half = torch.ones(BATCH, VIEWS, CELLS)
    half[:, :, ::2] = 0.0
    wrong = torch.where(half[..., None] > 0, cells.points, 9.0)
    with torch.inference_mode():
        one = network(query, torch.ones(BATCH, CELLS), dataclasses.replace(cells, coverage=half), HALF_TANGENT, start)
        other = network(query, torch.ones(BATCH, CELLS), FlowCells(cells.descriptors, wrong, half), HALF_TANGENT, start)
        nothing = network(query, torch.zeros(BATCH, CELLS), cells, HALF_TANGENT, start)
    assert not one.valid[:, ::2].any()
    torch.testing.assert_close(one.pose.R, other.pose.R)
    # A query that shows nothing leaves the pose as it is.
    assert not nothing.valid.any()
    torch.testing.assert_close(nothing.pose.R, start.R)
    torch.testing.assert_close(nothing.pose.centre, start.centre)


def test_only_what_should_appear_on_the_querys_mask_is_valid() -> None:
    cells, query, truth = scene()
    left = torch.zeros(BATCH, SIDE, SIDE)
    left[:, :, : SIDE // 2] = 1.0
    with torch.inference_mode():
        flow = flow_network()(query, left.flatten(1), cells, HALF_TANGENT, truth)
    # The mask falls over one cell about the middle.
    clear = flow.expected[..., 0].abs() > 1 / SIDE
    assert torch.equal(flow.valid[clear], (flow.expected[..., 0] < 0)[clear])


def test_learned_information_decides_in_which_direction_a_pose_moves() -> None:
    cells, query, truth = scene()
    start = one_view(truth.R[:, 0], truth.centre[:, 0] + 0.05, truth.log_scale[:, 0])
    found = []
    for bias in ([0.0, -6.0], [-6.0, 0.0]):
        network = flow_network()
        with torch.no_grad():
            network.read[-1].bias[2:4] = torch.tensor(bias)  # pyright: ignore[reportIndexIssue, reportOptionalSubscript]
            flow = network(query, torch.ones(BATCH, CELLS), cells, HALF_TANGENT, start)
        found.append((flow.pose.centre - start.centre)[:, 0].abs())
    assert (found[0][:, 0] > 3 * found[0][:, 1]).all()
    assert (found[1][:, 1] > 3 * found[1][:, 0]).all()


def test_the_nearer_half_of_the_templates_is_followed() -> None:
    turns = torch.tensor([[0.5, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 1.0], [0.2, 0.0, 0.0], [0.0, 0.0, 0.0]])
    R = random_rotations((1,), torch.Generator().manual_seed(0))
    numbers = torch.arange(5.0).view(1, 5, 1)
    cells = FlowCells(numbers[..., None], numbers[..., None].expand(1, 5, 1, 3), numbers)
    assert cells.nearer_half(so3_exp(turns)[None] @ R, R).coverage.flatten().tolist() == [4, 1, 3]
    assert cells.nearer_half(so3_exp(turns)[None, :1] @ R, R).coverage.flatten().tolist() == [0]


def test_an_edge_says_nothing_along_itself() -> None:
    # All is known of x and little of y: the centre moves in x as given, and hardly in y.
    cells, _, truth = scene()
    points = cells.points.flatten(1, 2)
    places = project(points, HALF_TANGENT, truth)[0][:, 0] + 0.1
    whitening = torch.diag(torch.tensor([1.0, 1e-4])).expand(BATCH, VIEWS * CELLS, 2, 2)
    weights = torch.ones(BATCH, VIEWS * CELLS)
    found = solve_poses(points, places, weights, HALF_TANGENT, truth, 8, whitening=whitening, damping=2e-3)
    torch.testing.assert_close(found.centre[:, 0, 0], torch.full((BATCH,), 0.1), atol=0.02, rtol=0)
    assert found.centre[:, 0, 1].abs().max() < 0.05
    both = solve_poses(points, places, weights, HALF_TANGENT, truth, 8, damping=2e-3)
    torch.testing.assert_close(both.centre, torch.full((BATCH, 1, 2), 0.1), atol=0.02, rtol=0)


@pytest.mark.parametrize("seed", range(2))
def test_gradients_reach_descriptors_and_reader_but_not_the_start(seed: int) -> None:
    cells, query, truth = scene(seed)
    network, start = flow_network(), off(truth, 5.0)
    torch.nn.init.normal_(network.read[-1].weight, std=0.01)  # pyright: ignore[reportArgumentType]
    query = query.clone().requires_grad_()
    start.R.requires_grad_()
    flow = network(query, torch.ones(BATCH, CELLS), cells, HALF_TANGENT, start)
    (flow.pose.R - truth.R).square().sum().backward()
    assert query.grad is not None and query.grad.any() and query.grad.isfinite().all()
    assert all(p.grad is not None and p.grad.any() for p in network.read.parameters())
    last = network.read[-1].bias.grad  # pyright: ignore[reportOptionalMemberAccess]
    assert isinstance(last, torch.Tensor) and (last != 0).all()
    assert start.R.grad is None


def test_correlations_are_those_of_the_query_interpolated_around_each_expected_position() -> None:
    g = torch.Generator().manual_seed(0)
    cells, query = (torch.randn((BATCH, CELLS, TINY.flow_width), generator=g) for _ in range(2))
    # Also far beyond the border, where the nearest cell counts.
    expected = 1.5 * torch.randn((BATCH, CELLS, 2), generator=g)
    network = flow_network()
    maps = query.mT.unflatten(-1, (SIDE, SIDE))
    around = expected[:, :, None] + network.offsets
    sampled = torch.nn.functional.grid_sample(maps, around, padding_mode="border", align_corners=False)
    wanted = torch.einsum("bcw,bwco->bco", cells, sampled)
    found = network._correlations(query, cells, expected)
    torch.testing.assert_close(found, wanted, rtol=1e-4, atol=1e-4)
