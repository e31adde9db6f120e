"""Batches follow from configuration and step alone: however many loaders there are, and from which step they start."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from simpick.estimators.raypose.network.config import preset
from simpick.training.data.batch_source import BatchSource
from simpick.training.data.batches import TrainingBatch
from simpick.training.distributed import Distributed
from simpick.training.resources import Resources
from tests.training.conftest import TINY_TRAINING

pytestmark = pytest.mark.render
NETWORK = preset("tiny")
CONFIG = replace(TINY_TRAINING, min_ready_shards=2)


def batches(shards: Path, steps: range, loaders: int) -> list[TrainingBatch]:
    resources = Resources(renderers=0, loaders=loaders, shards=shards, device="cpu")
    processes = Distributed.from_environment("cpu")
    with BatchSource(CONFIG, NETWORK, shards, resources, processes, steps.start) as source:
        return [source.get(step) for step in steps]


def test_loaders_and_the_first_step_change_nothing(tiny_shards: Path) -> None:
    alone = batches(tiny_shards, range(3), 0)
    loaded = batches(tiny_shards, range(1, 3), 1)
    for a, b in zip(alone[1:], loaded, strict=True):
        assert torch.equal(a.query.rgb, b.query.rgb) and torch.equal(a.query.masks, b.query.masks)
        assert torch.equal(a.templates.points, b.templates.points)
        assert torch.equal(a.view_angles_rad, b.view_angles_rad)
    assert not torch.equal(alone[0].query.rgb, alone[1].query.rgb)


def test_angles_are_infinite_for_other_parts_and_small_for_the_own_templates(tiny_shards: Path) -> None:
    (batch,) = batches(tiny_shards, range(1), 0)
    each, own = CONFIG.batch // CONFIG.parts, CONFIG.templates
    angles = batch.view_angles_rad
    assert angles.shape == (CONFIG.batch, CONFIG.batch * own)
    assert angles[:each, : each * own].isfinite().all() and angles[:each, each * own :].isinf().all()
    for k in range(CONFIG.batch):
        assert angles[k, k * own : (k + 1) * own].max() < 1.5
