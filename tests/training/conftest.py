"""A shard small enough to be made in a second or two, made once."""

import pytest

from simpick.rendering import TemplateConfig
from simpick.training.data_config import DataConfig
from simpick.training.shard import Shard
from simpick.training.shard_factory import make_shard

TINY = DataConfig(
    queries=6,
    queries_per_camera=4,
    cameras=4,
    count=(3, 4),
    mixed_share=0.0,
    diameter_px=(90.0, 120.0),
    image_width_px=320,
    image_height_px=240,
    crop_px=96,
    templates=TemplateConfig(views=12, size_px=32),
)


@pytest.fixture(scope="session")
def tiny_shard() -> Shard:
    return make_shard(TINY, 0, split="train")
