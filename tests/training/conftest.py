"""A shard small enough to be made in a second or two, made once."""

from dataclasses import replace
from pathlib import Path

import pytest

from simpick.rendering import TemplateConfig
from simpick.training.config import TrainConfig
from simpick.training.data.data_config import DataConfig
from simpick.training.data.shard import Shard
from simpick.training.data.shard_factory import make_shard

TINY = DataConfig(
    queries=6,
    queries_per_camera=4,
    cameras=4,
    count=(3, 4),
    mixed_share=0.0,
    randomizations=("default", "strong"),
    diameter_px=(90.0, 120.0),
    image_width_px=320,
    image_height_px=240,
    crop_px=96,
    templates=TemplateConfig(views=12, size_px=32),
)

TINY_TRAINING = TrainConfig(
    batch=4,
    parts=2,
    templates=3,
    repeats_per_query=1000.0,
    window=2,
    warmup_steps=2,
    data=TINY,
    validation_shards=1,
    validation_queries=3,
    validation_steps=2,
)
"""So few steps that all are drawn from the first shards."""


@pytest.fixture(scope="session")
def tiny_shards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder in which all runs on `TINY` find and leave their shards."""
    return tmp_path_factory.mktemp("shards")


@pytest.fixture(scope="session")
def tiny_shard() -> Shard:
    return make_shard(TINY, 0, split="train")


@pytest.fixture(scope="session")
def shard() -> Shard:
    """With enough views that templates can be near to any pose."""
    return make_shard(replace(TINY, templates=TemplateConfig(views=162, size_px=48)), 0, split="train")
