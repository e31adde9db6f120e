"""Each loss against numbers worked out by hand."""

import dataclasses
import math

import pytest
import torch

from simpick.errors import ConfigError
from simpick.estimators.raypose.network import losses
from simpick.estimators.raypose.network.loss_weights import LossWeights
from simpick.estimators.raypose.network.pose_maps import (
    canonical_rays,
    decode_pose_maps,
    encode_pose_maps,
    encode_rotation,
)
from simpick.geometry.torch_rotations import random_rotations, so3_exp
from tests.estimators.raypose.networks import random_views


def test_ray_reconstruction_is_the_mean_squared_length_of_the_difference() -> None:
    target = torch.zeros(1, 2, 2, 3)
    predicted = target.clone()
    predicted[0, 0, 0] = torch.tensor([1.0, 2.0, 2.0])  # squared length 9 in one of four cells
    assert losses.ray_reconstruction(predicted, target).item() == pytest.approx(9 / 4)


def test_ray_cosine_ignores_length() -> None:
    target = torch.tensor([1.0, 0.0, 0.0]).expand(2, 2, 3)
    predicted = torch.stack(
        [
            torch.tensor([5.0, 0.0, 0.0]),  # 1 - 1
            torch.tensor([0.0, 3.0, 0.0]),  # 1 - 0
            torch.tensor([-2.0, 0.0, 0.0]),  # 1 + 1
            torch.tensor([1.0, math.sqrt(3.0), 0.0]),  # 1 - cos 60 degrees
        ]
    ).view(2, 2, 3)
    assert losses.ray_cosine(predicted, target).item() == pytest.approx((0 + 1 + 2 + 0.5) / 4, abs=1e-6)


def test_ray_consistency_is_zero_for_every_rotation_and_any_length() -> None:
    R = random_rotations((20,), torch.Generator().manual_seed(0))
    assert losses.ray_consistency(3.0 * encode_rotation(R, 6)).item() < 1e-10


def test_ray_consistency_of_parallel_rays() -> None:
    # Canonical rays of a 2 x 2 grid are (+-0.5, +-0.5, 1): neighbours have cosine 1 / 1.5. Parallel rays have angle 0.
    parallel = torch.tensor([0.0, 0.0, 1.0]).expand(1, 2, 2, 3)
    assert losses.ray_consistency(parallel).item() == pytest.approx(math.acos(2 / 3) ** 2, rel=5e-3)


@pytest.mark.parametrize("axis", [0, 1])
def test_ray_consistency_looks_to_the_right_and_below(axis: int) -> None:
    # Rays that do not change along one axis are wrong for half of the neighbours.
    rays = canonical_rays(2).index_select(axis, torch.tensor([0, 0]))
    assert losses.ray_consistency(rays).item() == pytest.approx(math.acos(2 / 3) ** 2 / 2, rel=5e-3)


def test_ray_consistency_has_finite_gradients_at_parallel_and_opposite_rays() -> None:
    rays = torch.tensor([0.0, 0.0, 1.0]).repeat(2, 2, 1)
    rays[0, 0] = -rays[0, 0]
    rays.requires_grad_()
    losses.ray_consistency(rays).backward()
    assert rays.grad is not None
    assert rays.grad.isfinite().all()


def test_translation_reconstruction_is_the_mean_squared_length_of_the_difference() -> None:
    target = torch.ones(2, 3, 3, 3)
    assert losses.translation_reconstruction(target + 0.5, target).item() == pytest.approx(3 * 0.25)


def test_translation_xyz_is_the_relative_error_of_the_decoded_position() -> None:
    g = torch.Generator().manual_seed(0)
    query, reference = random_views((7,), g), random_views((7,), g)
    maps = encode_pose_maps(query, reference, 4, 1.2)
    assert losses.translation_xyz(maps[..., 3:], query, reference, 1.2).item() == pytest.approx(0, abs=1e-6)
    maps = maps + 0.2 * torch.randn(maps.shape, generator=g)
    half_tangent = torch.full((7,), 0.08)
    decoded = decode_pose_maps(maps, reference, 1.2).pose(half_tangent)[:, :3, 3]
    true = query.pose(half_tangent)[:, :3, 3]
    scale = torch.stack([query.half_extent_at_depth_m, query.half_extent_at_depth_m, true[:, 2]], dim=-1)
    expected = ((decoded - true).abs() / scale).sum(dim=-1).mean()
    assert losses.translation_xyz(maps[..., 3:], query, reference, 1.2).item() == pytest.approx(
        expected.item(), rel=1e-4
    )


def test_matching_is_the_cross_entropy_with_what_shows_the_same_place() -> None:
    places = torch.tensor([[[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.0, 0.0]]])
    log_p = torch.log(torch.tensor([[[0.5, 0.3, 0.2], [0.1, 0.6, 0.3]]]))
    query = torch.tensor([[[0.0, 0.0, 0.0], [0.3, 0.0, 0.0]]])
    every, both = torch.ones(1, 3, dtype=torch.bool), torch.ones(1, 2, dtype=torch.bool)
    # The first query cell is shown by template cells 0 and 2 alike, the second by cell 1 (0.3 is six sigma).
    expected = (-(math.log(0.5) + math.log(0.2)) / 2 - math.log(0.6)) / 2
    assert losses.matching(log_p, query, both, places, every).item() == pytest.approx(expected, rel=1e-4)
    # Without template cell 2 only cell 0 remains for the first.
    some = torch.tensor([[True, True, False]])
    expected = (-math.log(0.5) - math.log(0.6)) / 2
    assert losses.matching(log_p, query, both, places, some).item() == pytest.approx(expected, rel=1e-4)


def test_matching_leaves_out_what_no_template_shows_and_what_is_no_part() -> None:
    log_p = torch.log(torch.tensor([[[0.9, 0.1], [0.2, 0.8]]]))
    places = torch.tensor([[[0.0, 0.0, 0.0], [0.0, 0.5, 0.0]]])
    every = torch.ones(1, 2, dtype=torch.bool)
    far = torch.tensor([[[0.0, 0.0, 0.0], [0.0, 0.25, 0.0]]])
    assert losses.matching(log_p, far, every, places, every).item() == pytest.approx(-math.log(0.9), rel=1e-4)
    first = torch.tensor([[True, False]])
    assert losses.matching(log_p, places, first, places, every).item() == pytest.approx(-math.log(0.9), rel=1e-4)
    assert losses.matching(log_p, places, ~every, places, every).item() == 0


def test_visibility_costs_nothing_where_it_is_right_and_much_where_it_is_wrong() -> None:
    coverage = torch.tensor([[1.0, 0.0]])
    assert losses.visibility(coverage, coverage).item() == pytest.approx(0, abs=1e-4)
    assert losses.visibility(1 - coverage, coverage).item() > 5
    assert losses.visibility(torch.tensor([[0.5, 0.5]]), coverage).item() == pytest.approx(math.log(2), rel=1e-4)


def test_view_embeddings_are_to_choose_near_views_of_the_own_part() -> None:
    angles = torch.tensor([[0.0, 1.5, torch.inf], [torch.inf, torch.inf, 0.1]])
    right = torch.tensor([[9.0, 0.0, 0.0], [0.0, 0.0, 9.0]])
    assert losses.view_embedding(right, angles).item() < 0.01
    assert losses.view_embedding(right.roll(1, 0), angles).item() > 5
    # A query that no view is near to does not count.
    far = torch.tensor([[0.0, 1.5, torch.inf], [torch.inf, torch.inf, 1.0]])
    assert losses.view_embedding(right.roll(1, 0), far).item() == pytest.approx(
        losses.view_embedding(right.roll(1, 0)[:1], far[:1]).item(), rel=1e-5
    )


def test_the_overall_loss_weighs_every_term() -> None:
    names = [field.name for field in dataclasses.fields(LossWeights)]
    terms = {name: torch.tensor(float(k + 1)) for k, name in enumerate(names)}
    weights = LossWeights(**{name: 2.0**k for k, name in enumerate(names)})
    expected = sum((k + 1) * 2.0**k for k in range(len(names)))
    assert losses.weighted_sum(terms, weights).item() == pytest.approx(expected, rel=1e-6)


def test_true_maps_cost_nothing_and_terms_have_the_weights_names() -> None:
    g = torch.Generator().manual_seed(0)
    query, reference = random_views((3, 1), g), random_views((3, 2), g)
    maps = encode_pose_maps(query, reference, 4, 1.2)
    terms = losses.pose_map_losses(maps, maps, query, reference, 1.2)
    others = {"matching", "matched_points", "first", "flow_matching", "flow_offset", "flow_pose"}
    others |= {"view_embedding", "visibility"}
    assert {*terms} | others == {field.name for field in dataclasses.fields(LossWeights)}
    assert all(value.item() < 1e-5 for value in terms.values())
    wrong = losses.pose_map_losses(maps.roll(1, 0), maps, query, reference, 1.2)
    assert all(wrong[name].item() > 1e-3 for name in terms if name != "ray_consistency")


def test_weights_must_not_be_negative() -> None:
    with pytest.raises(ConfigError, match="ray_cosine must be at least 0, got -1"):
        LossWeights(ray_cosine=-1.0)
    with pytest.raises(ConfigError, match="matching must be a finite number, got nan"):
        LossWeights(matching=float("nan"))


def test_matched_points_are_as_far_off_as_they_are_and_far_ones_count_no_further() -> None:
    truth = torch.zeros(1, 3, 3)
    points = torch.tensor([[[0.03, 0.04, 0.0], [5.0, 0.0, 0.0], [1.0, 0.0, 0.0]]])
    seen = torch.tensor([[True, True, False]])
    expected = (0.15 * math.tanh(0.05 / 0.15) + 0.15) / 2
    assert losses.matched_points(points, truth, seen).item() == pytest.approx(expected, rel=1e-4)
    assert losses.matched_points(points, truth, ~seen & seen).item() == 0


def test_flow_costs_the_cross_entropy_to_a_normal_distribution_around_the_true_offset() -> None:
    offsets = torch.tensor([[-0.1, 0.0], [0.0, 0.0], [0.1, 0.0]])
    log_p = torch.log(torch.tensor([[[0.2, 0.5, 0.3], [1 / 3, 1 / 3, 1 / 3]]]))
    wanted, first = torch.tensor([[[0.1, 0.0], [5.0, 5.0]]]), torch.tensor([[True, False]])
    # Cells 0.1 wide, so offsets are 2, 1 and 0 cells from what is wanted; 0.6 cells of standard deviation.
    target = torch.tensor([math.exp(-4 / 0.72), math.exp(-1 / 0.72), 1.0])
    target = target / target.sum()
    expected = -(target * torch.log(torch.tensor([0.2, 0.5, 0.3]))).sum().item()
    assert losses.flow_matching(log_p, offsets, wanted, first, 0.1).item() == pytest.approx(expected, rel=1e-5)
    assert losses.flow_matching(log_p, offsets, wanted, ~first & False, 0.1).item() == 0


def test_flow_offsets_are_as_many_cells_off_as_they_are_and_far_ones_count_no_further() -> None:
    wanted = torch.tensor([[[0.0, 0.0], [0.3, 0.4], [9.0, 9.0], [7.0, 7.0]]])
    valid = torch.tensor([[True, True, True, False]])
    assert losses.flow_offset(torch.zeros(1, 4, 2), wanted, valid, 0.25).item() == pytest.approx((0 + 2 + 4) / 3)


def test_a_flow_pose_costs_turn_shift_and_size() -> None:
    g = torch.Generator().manual_seed(0)
    R, turn = random_rotations((1,), g), so3_exp(torch.tensor([[0.0, 0.1, 0.0]]))
    centre, log_scale = torch.tensor([[0.1, -0.2]]), torch.tensor([0.3])
    same = losses.flow_pose(R, centre, log_scale, R, centre, log_scale).item()
    assert same < 1e-5
    found = losses.flow_pose(turn @ R, centre + torch.tensor([0.02, -0.01]), log_scale - 0.05, R, centre, log_scale)
    chord = 2 * math.sqrt(2) * math.sin(0.05)
    assert found.item() == pytest.approx(0.3 * math.tanh(chord / 0.3) + 2 * 0.03 + 2 * 0.05, rel=1e-3)
    far = losses.flow_pose(turn @ turn @ turn @ R, centre + 5, log_scale + 5, R, centre, log_scale).item()
    assert far < 0.3 + 2 * 0.6 + 2 * 0.3
