"""Bins that are over leave no memory behind, whether or not Python's garbage collector runs."""

import gc
import weakref
from collections.abc import Iterator

import numpy as np
import pytest

from simpick.envs.bin_pick import BinPickEnv
from simpick.envs.bin_servo import BinServoEnv
from simpick.experiments.config import RunConfig
from simpick.experiments.episodes import make_env, make_policy, run_episode

pytestmark = pytest.mark.render


@pytest.fixture(autouse=True)
def _uncollected() -> Iterator[None]:
    gc.disable()
    yield
    gc.enable()


def opened_env(kind: type[BinPickEnv] | type[BinServoEnv]) -> tuple[BinPickEnv | BinServoEnv, weakref.ref]:
    env = kind(parts=["hex_nut"], count=1)
    env.reset(seed=0)
    env.step(np.zeros(10 if kind is BinPickEnv else 7))
    return env, weakref.ref(env.scene)


@pytest.mark.parametrize("kind", [BinPickEnv, BinServoEnv])
def test_close_frees_the_scene(kind: type[BinPickEnv] | type[BinServoEnv]) -> None:
    env, scene = opened_env(kind)
    env.close()
    assert scene() is None


@pytest.mark.parametrize("kind", [BinPickEnv, BinServoEnv])
def test_reset_frees_the_scene_before(kind: type[BinPickEnv] | type[BinServoEnv]) -> None:
    env, scene = opened_env(kind)
    env.reset(seed=1)
    assert scene() is None
    env.close()


def test_an_episode_frees_its_scene_and_environment() -> None:
    config = RunConfig(parts=("hex_nut",), count=1, estimator="oracle", detections="perfect")
    env = make_env(config)
    run_episode(env, make_policy(config, env, 0), 0)
    scene, env_ref = weakref.ref(env.scene), weakref.ref(env)
    env.close()
    del env
    assert scene() is None and env_ref() is None
