"""Batches of shards: their poses are those of the images, for every part and every kind of templates."""

import itertools
from dataclasses import fields, replace

import cv2
import numpy as np
import pytest
import torch

from simpick.estimators.raypose.crops.template_choice import align_turns, view_angles
from simpick.estimators.raypose.network.config import RayPoseConfig, preset
from simpick.geometry import SymmetryGroup, rotation_angle, transform_points
from simpick.training.config import TrainConfig
from simpick.training.data.augmentation import AugmentationConfig, perturb_mask
from simpick.training.data.batches import TrainingBatch, make_batch
from simpick.training.data.data_order import draw_shards, step_rng, window_at
from simpick.training.data.shard import OWN, Shard

pytestmark = pytest.mark.render

FINE = replace(preset("tiny"), templates=6, spread_deg=30.0)
COARSE = replace(FINE, spread_deg=180.0)
PLAIN = AugmentationConfig(
    turn=False,
    box_jitter=0.0,
    box_share=0.0,
    merged_share=0.0,
    hidden_share=0.0,
    hole_share=0.0,
    ragged_share=0.0,
    brightness=0.0,
)


@pytest.fixture(scope="module")
def symmetric(shard: Shard) -> Shard:
    """The same images, of a part declared to be symmetric under rotations by 60 degrees and upside down."""
    return replace(shard, symmetries=SymmetryGroup.cyclic(6, flips=True))


def batch_of(
    shard: Shard, network: RayPoseConfig, seed: int = 0, augmentation: AugmentationConfig | None = None
) -> TrainingBatch:
    rows = np.arange(len(shard))
    return make_batch([shard], [rows], network, np.random.default_rng(seed), augmentation=augmentation)


def equal(a: TrainingBatch, b: TrainingBatch) -> bool:
    return torch.equal(a.query.rgb, b.query.rgb) and torch.equal(a.templates.rgb, b.templates.rgb)


@pytest.mark.parametrize("network", [FINE, COARSE], ids=["fine", "coarse"])
@pytest.mark.parametrize("kind", ["shard", "symmetric"])
def test_what_a_cell_shows_lies_in_that_cell(network: RayPoseConfig, kind: str, request) -> None:
    shard = request.getfixturevalue(kind)
    batch = batch_of(shard, network, seed=3)
    cells = network.geometry_cells
    centres = (np.stack(np.meshgrid(*[np.arange(cells)] * 2), axis=-1).reshape(-1, 2) + 0.5) * 2 / cells - 1
    misses, count = [], 0
    for k, T in enumerate(batch.Ts_crop_part):
        seen = batch.coverage[k].numpy() > 0.5
        in_part_m = batch.points[k].double().numpy()[seen] * shard.diameter_m
        points_m = transform_points(T, in_part_m)
        assert (np.linalg.norm(in_part_m, axis=-1) < shard.diameter_m).all()
        in_half_sides = points_m[:, :2] / points_m[:, 2:] / float(batch.query.half_tangent[k])
        misses.append(np.abs(in_half_sides - centres[seen]).max(axis=-1))
        count += seen.sum()
    assert count > 3 * len(batch)
    # Half a cell, and a little because the mean of a slanted surface is not projected to the mean of its image.
    assert np.concatenate(misses).max() < 1.2 / cells


def test_the_true_pose_is_that_of_the_turned_image(shard: Shard) -> None:
    batch = batch_of(shard, FINE, seed=1)
    for k, T in enumerate(batch.Ts_crop_part):
        centre = T[:2, 3] / T[2, 3] / float(batch.query.half_tangent[k])
        assert torch.allclose(batch.truth.centre[k, 0].double(), torch.tensor(centre), atol=1e-5)
        assert torch.allclose(batch.truth.R[k, 0].double(), torch.tensor(T[:3, :3]), atol=1e-6)
        # Distance does not change when a camera turns about its centre.
        assert np.linalg.norm(T[:3, 3]) == pytest.approx(np.linalg.norm(shard.Ts_crop_part[k, :3, 3]))


@pytest.mark.parametrize("spread_deg", [15.0, 30.0, 90.0])
def test_fine_templates_lie_within_the_spread_of_a_pose_that_does(shard: Shard, spread_deg: float) -> None:
    network = replace(FINE, spread_deg=spread_deg)
    degrees = np.concatenate([template_angles_deg(batch_of(shard, network, seed)) for seed in range(16)]).ravel()
    # The pose that they are drawn around is off by the spread at most; views are 11 degrees from any direction at most.
    assert degrees.max() < 2 * spread_deg + 11
    assert (degrees < 1.6 * spread_deg).mean() > 0.9
    assert degrees.mean() > 0.3 * spread_deg, "they differ from the pose"


def template_angles_deg(batch: TrainingBatch) -> np.ndarray:
    R_relative = batch.truth.R.double() @ batch.templates.poses.R[batch.sets].double().mT
    return np.degrees(rotation_angle(R_relative.numpy()))


def test_coarse_templates_are_all_around(shard: Shard) -> None:
    degrees = template_angles_deg(batch_of(shard, COARSE))
    assert degrees.max() > 120 and degrees.min() < 100
    toward = batch_of(shard, COARSE).templates.poses.R[0, :, 2]
    assert toward.mean(dim=0).norm() < 0.5, "their viewing directions balance"


def test_coarse_queries_of_one_part_share_upright_templates(shard: Shard) -> None:
    batch = make_batch([shard, shard], [np.arange(3), np.array([0, 1, 2, 0])], COARSE, np.random.default_rng(0))
    assert batch.sets.tolist() == [0, 0, 0, 1, 1, 1, 1]
    assert batch.templates.coverage.shape[0] == 2
    upright = shard.templates.Ts_camera_part[:, :3, :3]
    for R in batch.templates.poses.R.flatten(0, 1).double().numpy():
        # But for the small turn that aims the crop's camera at the part.
        assert np.degrees(rotation_angle(R @ np.swapaxes(upright, -1, -2))).min() < 2


def test_a_coarse_query_is_about_as_upright_as_the_template_most_like_it(shard: Shard) -> None:
    batch = batch_of(shard, COARSE)
    templates = batch.templates.poses.R[0].double().numpy()
    for R in batch.truth.R[:, 0].double().numpy():
        nearest = templates[np.argmin(view_angles(templates, R))]
        # The crop's camera is aimed a few degrees aside of the one in which turns are measured.
        assert np.degrees(np.abs(align_turns(R[None], nearest)[0])) < 15 + 5


def test_fine_queries_have_templates_of_their_own(shard: Shard) -> None:
    batch = batch_of(shard, FINE)
    assert batch.sets.tolist() == list(range(len(batch))) and len(batch.templates.coverage) == len(batch)


def test_fixed_templates_are_always_the_same(shard: Shard) -> None:
    fixed, again = (batch_of(shard, replace(COARSE, template_views="fixed"), seed).templates.poses.R for seed in (0, 1))
    drawn, other = (batch_of(shard, COARSE, seed).templates.poses.R for seed in (0, 1))
    torch.testing.assert_close(fixed, again)
    assert (drawn - other).abs().max() > 0.5


def test_of_equivalent_poses_fine_templates_show_those_nearest_to_the_truth(symmetric: Shard) -> None:
    batch = batch_of(symmetric, FINE, seed=2)
    truths = batch.truth.R[:, 0].double().numpy()
    templates = batch.templates.poses.R.double().numpy()
    chosen = rotation_angle(truths[:, None] @ np.swapaxes(templates, -1, -2))
    for G in symmetric.symmetries.transforms():
        other = rotation_angle(truths[:, None] @ np.swapaxes(templates @ G[:3, :3], -1, -2))
        assert (chosen <= other + 1e-5).all()


def test_of_equivalent_poses_coarse_templates_show_those_nearest_to_the_first(symmetric: Shard) -> None:
    templates = batch_of(symmetric, COARSE, seed=2).templates.poses.R[0].double().numpy()
    chosen = rotation_angle(templates[0] @ np.swapaxes(templates, -1, -2))
    for G in symmetric.symmetries.transforms():
        assert (chosen <= rotation_angle(templates[0] @ np.swapaxes(templates @ G[:3, :3], -1, -2)) + 1e-5).all()


def test_a_coarse_truth_is_the_equivalent_pose_that_is_nearest_to_a_template(symmetric: Shard) -> None:
    batch = batch_of(symmetric, COARSE, seed=2)
    chosen = np.radians(template_angles_deg(batch)).min(axis=1)
    templates = batch.templates.poses.R[batch.sets].double().numpy()
    for G in symmetric.symmetries.transforms():
        truths = batch.truth.R[:, 0].double().numpy() @ G[:3, :3]
        assert (chosen <= rotation_angle(truths[:, None] @ np.swapaxes(templates, -1, -2)).min(axis=1) + 1e-5).all()


def test_a_batch_follows_from_its_generator(shard: Shard) -> None:
    assert equal(batch_of(shard, FINE, 5), batch_of(shard, FINE, 5))
    assert not equal(batch_of(shard, FINE, 5), batch_of(shard, FINE, 6))


@pytest.mark.parametrize("field", [f.name for f in fields(AugmentationConfig)])
def test_every_augmentation_changes_the_query(shard: Shard, field: str) -> None:
    # A neighbour that touches each query.
    labels = shard.labels.copy()
    labels[:, 60:, 60:][labels[:, 60:, 60:] != OWN] = OWN + 1
    labels[:, :60][labels[:, :60] != OWN] = OWN + 2
    shard = replace(shard, labels=labels)
    strong = replace(PLAIN, **{field: True if field == "turn" else 0.9})
    plain, changed = batch_of(shard, FINE, 1, PLAIN), batch_of(shard, FINE, 1, strong)
    assert not torch.equal(plain.query.masks, changed.query.masks) or not torch.equal(
        plain.query.rgb, changed.query.rgb
    )


def test_a_perturbed_mask_keeps_some_of_what_was_seen(shard: Shard) -> None:
    rng = np.random.default_rng(0)
    strong = AugmentationConfig(ragged_share=1.0, hidden_share=1.0, hole_share=1.0, merged_share=1.0)
    for labels, mask in zip(shard.labels, shard.masks, strict=True):
        for _ in range(5):
            assert (perturb_mask(labels, strong, rng) & mask).sum() >= 0.3 * mask.sum()


def test_a_cut_hides_some_of_the_mask_and_adds_nothing(shard: Shard) -> None:
    rng = np.random.default_rng(0)
    for labels, mask in zip(shard.labels, shard.masks, strict=True):
        cut = perturb_mask(labels, replace(PLAIN, hidden_share=1.0), rng)
        assert not (cut & ~mask).any()
        assert 0.45 * mask.sum() < cut.sum() < 0.97 * mask.sum()


def test_a_box_is_filled_and_a_hole_is_within_the_mask(shard: Shard) -> None:
    rng = np.random.default_rng(0)
    for labels, mask in zip(shard.labels, shard.masks, strict=True):
        box = perturb_mask(labels, replace(PLAIN, box_share=1.0), rng)
        rows, columns = np.nonzero(mask)
        assert box.sum() == (np.ptp(rows) + 1) * (np.ptp(columns) + 1) and box[mask].all()
        hole = mask & ~perturb_mask(labels, replace(PLAIN, hole_share=1.0), rng)
        assert hole.any()


def test_what_is_merged_shows_one_neighbour_that_touches() -> None:
    labels = np.zeros((80, 80), np.uint8)
    labels[20:50, 20:40] = OWN
    labels[20:50, 40:60] = OWN + 1
    labels[65:75, 65:75] = OWN + 2
    rng = np.random.default_rng(0)
    for _ in range(20):
        merged = perturb_mask(labels, replace(PLAIN, merged_share=1.0), rng)
        assert merged[labels == OWN].all()
        added = np.unique(labels[merged & (labels != OWN)])
        assert added.tolist() == [OWN + 1]


def test_a_wrong_outline_differs_only_near_the_outline(shard: Shard) -> None:
    rng = np.random.default_rng(0)
    differs = []
    for labels, mask in zip(shard.labels, shard.masks, strict=True):
        out = perturb_mask(labels, replace(PLAIN, ragged_share=1.0), rng)
        deep = cv2.erode(mask.astype(np.uint8), np.ones((31, 31), np.uint8)) > 0
        assert out[deep].all()
        differs.append((out != mask).any())
    assert np.mean(differs) > 0.5


def test_targets_do_not_depend_on_the_mask(shard: Shard) -> None:
    # Only the box follows the mask: with the same mask errors but another generator state for them, truth is the truth.
    batch = batch_of(shard, FINE, 1, replace(PLAIN, hole_share=1.0))
    plain = batch_of(shard, FINE, 1, PLAIN)
    shares = batch.coverage.mean(dim=1) / plain.coverage.mean(dim=1)
    # A hole rarely moves the box, and never what the query shows.
    assert shares.median() == pytest.approx(1.0, abs=0.05)
    assert (batch.query.masks.mean(dim=(1, 2)) < plain.query.masks.mean(dim=(1, 2)) - 1e-3).any()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"ragged_share": 1.5}, "ragged_share must be between 0 and 1, got 1.5"),
        ({"box_jitter": -0.1}, "box_jitter must be at least 0 and below 1, got -0.1"),
    ],
)
def test_augmentation_out_of_range_is_refused(change: dict, message: str) -> None:
    with pytest.raises(Exception, match=message):
        AugmentationConfig(**change)


def test_the_order_of_the_data_follows_from_seed_and_step() -> None:
    config = TrainConfig(seed=4)
    first = [draw_shards(config, step, step_rng(config, step, 0)) for step in range(30)]
    assert first == [draw_shards(config, step, step_rng(config, step, 0)) for step in range(30)]
    assert first != [draw_shards(config, step, step_rng(config, step, 1)) for step in range(30)]
    assert all(set(shards) <= set(window_at(config, step)) for step, shards in enumerate(first))


def test_the_window_passes_over_every_shard_as_often_as_asked() -> None:
    config = TrainConfig(batch=32, repeats_per_query=2.0, window=16)
    starts = [window_at(config, step).start for step in range(4000)]
    assert all(0 <= after - before <= 1 for before, after in itertools.pairwise(starts))
    shards_passed = starts[-1] - starts[2000]
    queries_seen = 32 * (4000 - 1 - 2000)
    assert queries_seen / (shards_passed * config.data.queries) == pytest.approx(2.0, rel=0.02)
    assert {len(window_at(config, step)) for step in range(2000, 4000)} == {16}
