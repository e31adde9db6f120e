import pytest

from simpick.scene import SceneConfig, build_scene

PARTS = ("hex_bolt", "pipe_tee", "l_bracket", "terminal_block")


@pytest.fixture(scope="package")
def config():
    return SceneConfig(parts=PARTS, count=8)


@pytest.fixture
def scene(config):
    return build_scene(config, seed=1)
