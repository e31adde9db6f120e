"""What flow is taught: nothing to correct at the true pose, and the way back from a wrong one."""

import dataclasses

import numpy as np
import pytest
import torch

from simpick.estimators.raypose.diffusion.schedule import make_schedule
from simpick.estimators.raypose.network.config import preset
from simpick.estimators.raypose.network.flow import Flow
from simpick.estimators.raypose.network.loss_weights import LossWeights
from simpick.estimators.raypose.network.losses import weighted_sum
from simpick.estimators.raypose.network.model import RayPose
from simpick.estimators.raypose.network.pose_solver import SolvedPoses, project
from simpick.training.data.augmentation import AugmentationConfig
from simpick.training.data.batches import TrainingBatch, make_batch
from simpick.training.data.flow_targets import flow_terms
from simpick.training.data.shard import Shard
from simpick.training.training_step import loss_terms, matching_terms

NETWORK = preset("tiny")


@pytest.fixture
def batch(shard: Shard) -> TrainingBatch:
    plain = AugmentationConfig(
        box_jitter=0.0,
        box_share=0.0,
        merged_share=0.0,
        hidden_share=0.0,
        hole_share=0.0,
        ragged_share=0.0,
        brightness=0.0,
    )
    rows = np.arange(min(8, len(shard)))
    return make_batch([shard], [rows], NETWORK, np.random.default_rng(0), augmentation=plain)


@pytest.fixture
def model() -> RayPose:
    torch.manual_seed(0)
    return RayPose(NETWORK).eval()


def true_pose(batch: TrainingBatch) -> SolvedPoses:
    log_scale = (batch.templates.diameter_m[batch.sets][:, None] / batch.truth.half_extent_at_depth_m).log()
    return SolvedPoses(batch.truth.R, batch.truth.centre, log_scale)


def measured(model: RayPose, batch: TrainingBatch, pose: SolvedPoses, offset: torch.Tensor | float) -> Flow:
    """Return a flow around a pose that found this offset everywhere."""
    assert model.flow is not None
    points = batch.templates.points[:, :2].flatten(1, 2)
    valid = batch.templates.coverage[:, :2].flatten(1, 2) > 0.3
    expected = project(points, batch.query.half_tangent, pose)[0][:, 0]
    logits = torch.zeros(*valid.shape, len(model.flow.offsets)).log_softmax(dim=-1)
    return Flow(points, valid, expected, logits, torch.zeros_like(expected) + offset, pose)


def test_at_the_true_pose_there_is_nothing_to_correct(model: RayPose, batch: TrainingBatch) -> None:
    terms = flow_terms(model, batch, measured(model, batch, true_pose(batch), 0.0))
    assert terms["flow_offset"] < 1e-4
    assert terms["flow_pose"] < 1e-4


def test_from_a_shifted_pose_the_way_back_is_wanted(model: RayPose, batch: TrainingBatch) -> None:
    assert model.flow is not None
    truth, shift = true_pose(batch), model.flow.unit / 2
    shifted = SolvedPoses(truth.R, truth.centre + shift, truth.log_scale)
    stayed = flow_terms(model, batch, measured(model, batch, shifted, 0.0))
    back = flow_terms(model, batch, measured(model, batch, shifted, -shift))
    # Half a cell to the side and half a cell down; perspective makes of it a little more or less.
    assert float(stayed["flow_offset"]) == pytest.approx(0.5 * 2**0.5, abs=0.03)
    assert back["flow_offset"] < 0.03
    assert float(stayed["flow_pose"]) == pytest.approx(2 * 2 * shift, rel=0.01)


def test_flow_is_measured_in_single_precision_whatever_runs_around_it(model: RayPose, batch: TrainingBatch) -> None:
    with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16):
        query, templates = model.encode_query(batch.query), model.encode_templates(batch.templates)
        assert query.flow_descriptors.dtype == torch.bfloat16
        flow = model.initial_poses(query, templates.for_queries(batch.sets)).flow
        terms = matching_terms(model, batch)
    assert flow is not None
    assert {flow.offset.dtype, flow.expected.dtype, flow.pose.R.dtype} == {torch.float32}
    assert all(value.isfinite() for value in terms.values())


def test_exactly_what_the_query_hides_is_not_taught(model: RayPose, batch: TrainingBatch) -> None:
    truth, side = true_pose(batch), NETWORK.geometry_cells
    left = batch.coverage.unflatten(-1, (side, side)).clone()
    left[:, :, : side // 2] = 0.0
    hidden = TrainingBatch(**{**vars(batch), "coverage": left.flatten(1)})
    flow = measured(model, batch, truth, 0.0)
    # Wrong by one half side where it is hidden, right elsewhere.
    x_offset = (flow.expected[..., 0] < 0).float()
    flow = dataclasses.replace(flow, offset=torch.stack([x_offset, torch.zeros_like(x_offset)], dim=-1))
    assert flow_terms(model, hidden, flow)["flow_offset"] < 1e-4
    assert flow_terms(model, batch, flow)["flow_offset"] > 0.5


def test_targets_are_exact_whatever_runs_around_them(model: RayPose, batch: TrainingBatch) -> None:
    with torch.autocast("cpu", torch.bfloat16):
        terms = flow_terms(model, batch, measured(model, batch, true_pose(batch), 0.0))
    assert terms["flow_offset"] < 1e-3


def test_places_that_the_query_hides_are_not_taught(model: RayPose, batch: TrainingBatch) -> None:
    truth = true_pose(batch)
    hidden = torch.zeros_like(batch.coverage)
    nothing = TrainingBatch(**{**vars(batch), "coverage": hidden})
    far = TrainingBatch(**{**vars(batch), "points": batch.points + 0.2})
    for other in (nothing, far):
        terms = flow_terms(model, other, measured(model, batch, truth, 1.0))
        assert terms["flow_offset"] == 0 and terms["flow_matching"] == 0
    assert flow_terms(model, batch, measured(model, batch, truth, 1.0))["flow_offset"] > 1


def test_a_step_in_half_precision_has_losses_like_one_in_single(model: RayPose, batch: TrainingBatch) -> None:
    def terms(enabled: bool) -> dict[str, torch.Tensor]:
        with torch.autocast("cpu", torch.bfloat16, enabled=enabled):
            return loss_terms(model, batch, make_schedule("log_snr"), torch.Generator().manual_seed(0))

    # Poses solved from the matches of random weights differ more than those of trained ones.
    half, single = terms(True), terms(False)
    for name, value in single.items():
        assert half[name].item() == pytest.approx(value.item(), rel=0.5, abs=0.05), name
    weighted_sum(half, LossWeights()).backward()
    assert all(p.grad is None or p.grad.isfinite().all() for p in model.parameters())
