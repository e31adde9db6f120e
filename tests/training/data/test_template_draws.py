"""Which templates training batches hold follows from the network's configuration."""

import dataclasses

import numpy as np
import pytest
import torch

from simpick.estimators.raypose.network.config import RayPoseConfig, preset
from simpick.geometry.torch_rotations import rotation_angle
from simpick.training.data.batches import TrainingBatch, make_batch
from simpick.training.data.shard import Shard

FINE = dataclasses.replace(preset("tiny"), templates=4)
COARSE = dataclasses.replace(FINE, spread_deg=180.0)


def batch(shard: Shard, config: RayPoseConfig, seed: int = 0) -> TrainingBatch:
    return make_batch([shard], [np.arange(len(shard))], config, np.random.default_rng(seed))


def template_angles_deg(b: TrainingBatch) -> torch.Tensor:
    """Return the angles between the templates and their query's true pose."""
    return torch.rad2deg(rotation_angle(b.templates.poses.R[b.sets] @ b.truth.R.mT))


@pytest.mark.render
def test_fine_templates_are_nearer_than_coarse_ones(tiny_shard: Shard) -> None:
    fine, coarse = (template_angles_deg(batch(tiny_shard, config)) for config in (FINE, COARSE))
    assert fine.median() < 60 < coarse.median()


@pytest.mark.render
def test_the_spread_in_metres_moves_and_scales_the_frames(tiny_shard: Shard) -> None:
    none, much = (batch(tiny_shard, dataclasses.replace(FINE, spread_m=spread)).templates for spread in (0.0, 0.3))
    # The same views and turns; only their frames differ.
    covered = [templates.masks.mean(dim=(-2, -1)) for templates in (none, much)]
    scale = much.half_tangent / none.half_tangent
    assert 0.65 < scale.min() < 0.95 < 1.05 < scale.max() < 1.4
    assert (much.poses.centre - none.poses.centre).abs().max() > 0.1
    assert (covered[0] - covered[1]).abs().max() > 0.02
