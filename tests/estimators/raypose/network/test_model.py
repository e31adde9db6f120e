"""The whole network: who sees whom, what is computed once, and what each ablation switches off."""

import dataclasses

import pytest
import torch

from simpick.estimators.raypose.diffusion.schedule import make_schedule
from simpick.estimators.raypose.network.cell_geometry import cells_per_token, coarser_geometry
from simpick.estimators.raypose.network.cell_subset import CellSubset
from simpick.estimators.raypose.network.consensus import consensus_pose, consensus_score
from simpick.estimators.raypose.network.model import RayPose
from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.estimators.raypose.sample_views import sample_views
from simpick.geometry.torch_rotations import project_to_so3, random_rotations, so3_exp
from tests.estimators.raypose.networks import (
    TINY,
    awake,
    condition,
    noisy_maps,
    random_query,
    random_templates,
    random_views,
    without,
)

SWITCHES = ("matching", "flow", "relative_pose", "multiview", "template_pose")
CONFIGS = [TINY, *(without(switch) for switch in SWITCHES)]
each_ablation = pytest.mark.parametrize("config", CONFIGS, ids=["whole", *(f"no {s}" for s in SWITCHES)])
ONE = slice(1, 2)


def denoised(model: RayPose, query, templates, maps: torch.Tensor, level: float | list[float] = -2.0) -> torch.Tensor:
    with torch.inference_mode():
        return model.denoise(maps, torch.tensor(level).expand(len(maps)), condition(model, query, templates))


def changed(templates, view: int, **fields: torch.Tensor):
    """Return the templates with other values in one view."""
    new = {}
    for name, value in fields.items():
        whole = getattr(templates, name).clone()
        whole[:, view] = value
        new[name] = whole
    return dataclasses.replace(templates, **new)


@each_ablation
def test_an_answer_does_not_depend_on_the_other_queries(config) -> None:
    model, query, templates, maps = awake(config), random_query(3), random_templates(3, config), noisy_maps(3)
    together = denoised(model, query, templates, maps, [1.0, -2.0, -7.0])
    alone = denoised(model, query.rows(ONE), templates.rows(ONE), maps[ONE])
    assert together.shape == maps.shape
    torch.testing.assert_close(together[ONE], alone, rtol=1e-4, atol=1e-5)
    # And it does depend on the query, its templates and the noise level.
    neighbour = denoised(model, query.rows(slice(2, 3)), templates.rows(ONE), maps[ONE])
    assert (neighbour - alone).abs().max() > 1e-3
    other = denoised(model, query.rows(ONE), templates.rows(slice(2, 3)), maps[ONE])
    assert (other - alone).abs().max() > 1e-3
    assert (denoised(model, query.rows(ONE), templates.rows(ONE), maps[ONE], 1.0) - alone).abs().max() > 1e-3


@each_ablation
def test_gradients_reach_what_a_configuration_uses(config) -> None:
    model, maps = awake(config), noisy_maps(2)
    out = model.denoise(maps, torch.tensor([0.0, -4.0]), condition(model, random_query(2), random_templates(2, config)))
    out.square().sum().backward()
    silent = {name.split(".")[0] for name, p in model.named_parameters() if p.grad is None or not p.grad.any()}
    matching_off = not (config.matching and config.template_pose)
    expected = {"matcher", "embed_matches"} if matching_off else set()
    expected |= {"visibility"} if matching_off else set()
    expected |= set() if config.template_pose else {"embed_geometry", "view_encoder"}
    # The decoder does not use the embedding of views.
    expected |= {"view_embedding"}
    assert silent <= expected
    assert all(p.grad.isfinite().all() for p in model.parameters() if p.grad is not None)


def test_a_new_network_answers_with_the_templates_poses() -> None:
    torch.manual_seed(0)
    # With matching, a new network answers with the pose solved from its matches.
    config = without("matching")
    model, templates = RayPose(config).eval(), random_templates(2, config)
    with torch.inference_mode():
        views = sample_views(
            model, condition(model, random_query(2), templates), make_schedule(), 3, torch.Generator().manual_seed(0)
        )
    torch.testing.assert_close(views.R, templates.poses.R, atol=1e-5, rtol=0)
    torch.testing.assert_close(views.centre, torch.zeros(2, 3, 2), atol=1e-6, rtol=0)
    torch.testing.assert_close(views.half_extent_at_depth_m, templates.poses.half_extent_at_depth_m)


def test_keys_and_values_are_computed_once_for_all_steps() -> None:
    model = awake(dataclasses.replace(TINY, decoder_blocks=2))
    calls = []
    for block in model.decoder.blocks:
        block.cross_attention.to_kv.register_forward_hook(lambda *_: calls.append(1))  # pyright: ignore
    model.image_encoder.register_forward_hook(lambda *_: calls.append(10))
    with torch.inference_mode():
        conditioning = condition(model, random_query(2), random_templates(2))
        assert sorted(calls) == [1, 1, 1, 1, 10, 10]
        sample_views(model, conditioning, make_schedule(), 7, torch.Generator().manual_seed(0))
    assert sorted(calls) == [1, 1, 1, 1, 10, 10]


@pytest.mark.parametrize("multiview", [True, False])
def test_single_view_hypotheses_depend_on_their_own_template_only(multiview: bool) -> None:
    model, maps = awake(dataclasses.replace(TINY, multiview=multiview)), noisy_maps(2)
    query, templates = random_query(2), random_templates(2)
    before = denoised(model, query, templates, maps)
    other = changed(
        templates, 2, rgb=1 - templates.rgb[:, 2], points=-templates.points[:, 2], coverage=1 - templates.coverage[:, 2]
    )
    after = denoised(model, query, other, maps)
    moved = (after - before).abs().amax(dim=(0, 2, 3, 4))
    assert moved[2] > 1e-3
    assert bool((moved[:2] > 1e-4).all()) == multiview
    if not multiview:
        torch.testing.assert_close(after[:, :2], before[:, :2])


@each_ablation
def test_noise_of_one_template_does_not_reach_anothers_hypothesis(config) -> None:
    model, query, templates, maps = awake(config), random_query(2), random_templates(2, config), noisy_maps(2)
    moved = maps.clone()
    moved[:, 0] += 1
    difference = denoised(model, query, templates, moved) - denoised(model, query, templates, maps)
    assert difference[:, 0].abs().max() > 1e-3
    torch.testing.assert_close(difference[:, 1:], torch.zeros_like(difference[:, 1:]), atol=1e-5, rtol=0)


@pytest.mark.parametrize("template_pose", [True, False])
def test_without_template_poses_tokens_do_not_know_them(template_pose: bool) -> None:
    config = TINY if template_pose else without("template_pose")
    model, templates = awake(config), random_templates(2, config)
    others = dataclasses.replace(
        templates,
        poses=random_views((2, 3), torch.Generator().manual_seed(9)),
        points=-templates.points,
        coverage=1 - templates.coverage,
        diameter_m=2 * templates.diameter_m,
    )
    query, maps = random_query(2), noisy_maps(2)
    with torch.inference_mode():
        a, b = (model.fuse(model.encode_templates(t)).tokens for t in (templates, others))
    assert torch.equal(a, b) == (not template_pose)
    a, b = (denoised(model, query, t, maps) for t in (templates, others))
    assert torch.equal(a, b) == (not template_pose)


def test_absolute_poses_are_relative_to_the_same_view_for_all_templates() -> None:
    model, templates = awake(dataclasses.replace(TINY, relative_pose=False)), random_templates(2)
    with torch.inference_mode():
        reference = condition(model, random_query(2), templates).reference
        relative = condition(awake(), random_query(2), templates).reference
    torch.testing.assert_close(reference.R, torch.eye(3).expand(2, 3, 3, 3))
    torch.testing.assert_close(reference.centre, torch.zeros(2, 3, 2))
    torch.testing.assert_close(reference.half_extent_at_depth_m, templates.diameter_m[:, None].expand(2, 3))
    assert relative is templates.poses


def test_without_matching_there_are_no_matches() -> None:
    config = without("matching")
    assert condition(awake(config), random_query(1), random_templates(1, config)).initial is None
    assert condition(awake(), random_query(1), random_templates(1)).initial is not None


def test_patches_hold_the_cells_of_each_token() -> None:
    rows, columns = torch.meshgrid(torch.arange(6.0), torch.arange(6.0), indexing="ij")
    patches = cells_per_token(torch.stack([rows, columns], dim=-1).flatten(0, 1)[None], 3)
    assert patches.shape == (1, 9, 4 * 2)
    # Token 5 is row 1, column 2 of the 3 x 3 map: rows 2-3 and columns 4-5 of the cells.
    assert patches[0, 5].view(4, 2).tolist() == [[2, 4], [2, 5], [3, 4], [3, 5]]


def test_fewer_templates_than_trained_with_can_be_used() -> None:
    model = awake()
    few = dataclasses.replace(TINY, templates=2)
    assert denoised(model, random_query(2), random_templates(2, few), noisy_maps(2, few)).shape == (2, 2, 3, 3, 6)


def test_sampled_poses_are_deterministic_and_independent_of_the_batch() -> None:
    model, query, templates = awake(), random_query(3), random_templates(3)

    def run(rows: slice, seed: int = 0) -> ViewPoses:
        with torch.inference_mode():
            conditioning = condition(model, query.rows(rows), templates.rows(rows))
            return sample_views(model, conditioning, make_schedule(), 4, torch.Generator().manual_seed(seed))

    every = slice(0, 3)
    first = run(every)
    assert torch.equal(first.R, run(every).R)
    torch.testing.assert_close(run(ONE).R, first.R[ONE], atol=1e-4, rtol=0)
    torch.testing.assert_close(run(ONE).half_extent_at_depth_m, first.half_extent_at_depth_m[ONE], rtol=1e-4, atol=0)
    assert (run(every, seed=1).R - first.R).abs().max() > 1e-5
    torch.testing.assert_close(torch.linalg.det(first.R), torch.ones(3, 3))


def test_views_are_combined_without_the_ones_that_disagree() -> None:
    g = torch.Generator().manual_seed(0)
    truth = random_rotations((2,), g)
    near = so3_exp(0.02 * torch.randn((2, 6, 3), generator=g)) @ truth[:, None]
    R = torch.cat([near, random_rotations((2, 2), g)], dim=1)
    centre = torch.zeros(2, 8, 2)
    centre[:, 6:] = 5.0
    reach = torch.full((2, 8), 0.03)
    reach[:, :6] *= torch.tensor([0.5, 2.0, 1.0, 1.0, 1.0, 1.0])
    pose = consensus_pose(ViewPoses(R, centre, reach))
    torch.testing.assert_close(pose.R, project_to_so3(near.mean(dim=1)), atol=5e-3, rtol=0)
    torch.testing.assert_close(pose.centre, torch.zeros(2, 2), atol=5e-3, rtol=0)
    torch.testing.assert_close(pose.half_extent_at_depth_m, torch.full((2,), 0.03), atol=0, rtol=0.02)
    only = ViewPoses(R[:, :1], centre[:, :1], reach[:, :1])
    torch.testing.assert_close(consensus_pose(only).R, R[:, 0])


def test_agreement_falls_with_the_angle_between_views() -> None:
    axis = torch.tensor([0.0, 0.0, 1.0])
    found = []
    for angle in (0.0, 0.1, 0.3):
        R = so3_exp(torch.tensor([[0.0], [angle]]) * axis)[None]
        found.append(float(consensus_score(ViewPoses(R, torch.zeros(1, 2, 2), torch.ones(1, 2)))))
    assert found[0] == pytest.approx(1.0, abs=1e-3)
    assert found[0] > found[1] > found[2] > 0


def test_geometry_on_half_as_many_cells_is_the_mean_over_what_is_covered() -> None:
    points, coverage = torch.zeros(1, 16, 3), torch.zeros(1, 16)
    # The upper left four cells of a 4 x 4 grid: one whole, one half covered.
    points[0, 0], points[0, 1] = torch.tensor([1.0, 2.0, 3.0]), torch.tensor([4.0, 2.0, 0.0])
    coverage[0, 0], coverage[0, 1] = 1.0, 0.5
    points[0, 15], coverage[0, 15] = torch.tensor([7.0, 8.0, 9.0]), 0.2
    half, covered = coarser_geometry(points, coverage)
    torch.testing.assert_close(half[0], torch.tensor([[2.0, 2, 2], [0, 0, 0], [0, 0, 0], [7, 8, 9]]))
    torch.testing.assert_close(covered[0], torch.tensor([0.375, 0, 0, 0.05]))


def test_flow_starts_from_the_matched_pose_and_is_every_views_answer() -> None:
    query, templates = random_query(2), random_templates(2)
    model = awake()
    with torch.inference_mode():
        first = condition(model, query, templates).initial
    assert first is not None and first.flow is not None
    # Two of three templates, each with all its cells.
    assert first.flow.points.shape == (2, 2 * TINY.flow_cells**2, 3)
    assert (first.poses.R[:, 0] == first.flow.pose.R[:, 0]).all()
    assert (first.poses.R[:, :1] == first.poses.R).all()
    assert (first.poses.R - first.solved.R).abs().max() > 1e-4
    config = without("flow")
    with torch.inference_mode():
        plain = condition(awake(config), query, random_templates(2, config)).initial
    assert plain is not None and plain.flow is None and plain.poses is plain.solved


def test_cells_beside_the_part_change_no_pose() -> None:
    model, queries, inputs = awake(TINY), random_query(3), random_templates(3)
    with torch.inference_mode():
        query, templates = model.encode_query(queries), model.encode_templates(inputs)
        everything = model.initial_poses(query, templates)
        covered = model.initial_poses(query, templates, covered_only=True)
    assert covered.matches.logits.shape[-1] < everything.matches.logits.shape[-1]
    torch.testing.assert_close(covered.matches.points, everything.matches.points)
    torch.testing.assert_close(covered.matches.similarity, everything.matches.similarity)
    torch.testing.assert_close(covered.poses.R, everything.poses.R, rtol=1e-4, atol=1e-4)


def test_answers_from_what_was_searched_are_those_from_scratch() -> None:
    model, queries, inputs = awake(TINY), random_query(3), random_templates(3)
    with torch.inference_mode():
        query, templates = model.encode_query(queries), model.encode_templates(inputs)
        searched = model.search(query, templates)
        followed = model.follow(query, templates, searched)
        poses = model.initial_poses(query, templates).poses
    assert searched.flow is None
    torch.testing.assert_close(followed.poses.R, poses.R, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(followed.poses.centre, poses.centre, rtol=1e-4, atol=1e-4)


def test_a_subset_of_cells_is_taken_in_order_and_put_back() -> None:
    subset = CellSubset.of(torch.tensor([[False, True, False, True], [False, False, False, True]]))
    cells = torch.arange(8.0).view(2, 4, 1)
    # The second row needs one cell less, and takes another.
    assert subset.take(cells).squeeze(-1).tolist() == [[1.0, 3.0], [7.0, 4.0]]
    assert subset.put(subset.take(cells), 4).squeeze(-1).tolist() == [[0.0, 1.0, 0.0, 3.0], [4.0, 0.0, 0.0, 7.0]]
    assert CellSubset.of(torch.zeros(2, 4, dtype=torch.bool)).index.shape == (2, 1)
