"""Validation reports errors of sampled poses in degrees and percent for every kind of network."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from simpick.estimators.raypose.diffusion.schedule import make_schedule
from simpick.estimators.raypose.network.config import preset
from simpick.estimators.raypose.network.model import RayPose
from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.geometry.torch_rotations import so3_exp
from simpick.training import validation
from simpick.training.data.shard import Shard
from simpick.training.validation import Validation
from tests.training.conftest import TINY_TRAINING

pytestmark = pytest.mark.render

NETWORK = replace(preset("tiny"), templates=3)


def figures(shard: Shard, monkeypatch: pytest.MonkeyPatch, deg: float, depth_factor: float, right: int) -> dict:
    """Return what is measured where all views of the first `right` queries are so far off, the others by far more."""
    measured = Validation([shard], NETWORK, replace(TINY_TRAINING, validation_queries=len(shard)))
    truth = measured._right[0].truth
    errors_deg = torch.full((len(shard), 1), 170.0)
    errors_deg[:right] = deg
    turn = so3_exp(torch.deg2rad(errors_deg)[..., None] * torch.tensor([0.0, 0.6, 0.8]))
    answer = ViewPoses(
        (turn @ truth.R).expand(-1, 3, -1, -1),
        truth.centre.expand(-1, 3, -1),
        depth_factor * truth.half_extent_at_depth_m.expand(-1, 3),
    )
    monkeypatch.setattr(validation, "consensus_pose", lambda _: answer.map(lambda x: x[:, 0]))
    return measured.measure(RayPose(NETWORK), make_schedule())


def test_errors_are_those_of_the_answer(tiny_shard: Shard, monkeypatch: pytest.MonkeyPatch) -> None:
    count = len(tiny_shard)
    assert tiny_shard.symmetries.is_trivial and count >= 3
    exact = figures(tiny_shard, monkeypatch, 0.0, 1.0, count)
    assert exact["rotation_deg"] == pytest.approx(0.0, abs=0.1) and exact["depth_percent"] == pytest.approx(0, abs=1e-4)
    off = figures(tiny_shard, monkeypatch, 12.0, 1.03, count - 1)
    assert off["rotation_deg"] == pytest.approx(12.0, abs=0.1)
    assert off["depth_percent"] == pytest.approx(3.0, abs=1e-3)
    assert off["below_5_deg"] == 0
    assert off["below_15_deg"] == off["below_30_deg"] == pytest.approx((count - 1) / count)


def test_the_same_network_measures_the_same_and_is_left_in_training(tiny_shard: Shard) -> None:
    model = RayPose(NETWORK).train()
    first, again = (Validation([tiny_shard], NETWORK, TINY_TRAINING).measure(model, make_schedule()) for _ in range(2))
    assert first == again and model.training
    assert np.isfinite(list(first.values())).all()
    assert {"rotation_deg", "denoised_rotation_deg", "wrong_masks_rotation_deg", "view_deg"} <= first.keys()


def test_the_chosen_view_is_compared_over_all_templates(tiny_shard: Shard, monkeypatch: pytest.MonkeyPatch) -> None:
    measured = Validation([tiny_shard], NETWORK, TINY_TRAINING)
    angles = measured._wrong[0].view_angles_rad
    model = RayPose(NETWORK)
    monkeypatch.setattr(model.view_embedding, "logits", lambda *_: -angles)
    best = measured.measure(model, make_schedule())["view_deg"]
    assert best == pytest.approx(float(np.median(np.degrees(angles.numpy().min(axis=1)))), abs=1e-3)
    monkeypatch.setattr(model.view_embedding, "logits", lambda *_: angles)
    assert measured.measure(model, make_schedule())["view_deg"] > best + 5
