"""`BinPickVectorEnv`: the same bins as single environments, in processes that end and fail in the open."""

import os
import pickle
import signal

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import simpick  # noqa: F401 - registers the environments
from simpick.envs.actions import ABSTAIN
from simpick.envs.bin_pick import BinPickEnv
from simpick.envs.bin_pick_vector import BinPickVectorEnv
from simpick.errors import ConfigError, UnknownPartError, WorkerDiedError
from simpick.records import PickOutcome
from tests.small_scenes import small_scene

CONFIG = small_scene("hex_bolt", "pipe_tee", count=2)
IDLE = np.stack([ABSTAIN, ABSTAIN])


@pytest.fixture(scope="module")
def envs():
    envs = gymnasium.make_vec(
        "simpick/BinPick-v0", 2, vectorization_mode="vector_entry_point", scene_config=CONFIG, render_mode="rgb_array"
    )
    yield envs
    envs.close()


def same(rows: dict, k: int, observation: dict) -> bool:
    return rows.keys() == observation.keys() and all(np.array_equal(rows[key][k], observation[key]) for key in rows)


@pytest.mark.render
def test_each_environment_plays_what_a_single_one_plays(envs) -> None:
    assert isinstance(envs, BinPickVectorEnv)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    single = BinPickEnv(scene_config=CONFIG)
    observations, infos = envs.reset(seed=3)
    alone, info = single.reset(seed=4)
    assert observations in envs.observation_space
    assert same(observations, 1, alone)
    np.testing.assert_array_equal(infos["truth"]["T_world_part"][1], info["truth"]["T_world_part"])
    assert envs.instance_part_names(1) == single.instance_part_names()
    for ours, theirs in zip(envs.truth(1), single.truth(), strict=True):
        assert (ours.instance, ours.part, ours.in_bin) == (theirs.instance, theirs.part, theirs.in_bin)
        np.testing.assert_array_equal(ours.T_world_part, theirs.T_world_part)
    # Two failures end the episode; the step after resets to the bin that a single environment continues with.
    for ends in (False, True):
        observations, rewards, terminated, _, infos = envs.step(IDLE)
        alone, reward, *_ = single.step(ABSTAIN)
        assert same(observations, 1, alone) and rewards[1] == reward
        assert terminated.tolist() == [ends, ends]
        assert infos["pick"][1].outcome is PickOutcome.NO_GRASP
    observations, rewards, terminated, _, infos = envs.step(IDLE)
    alone, _ = single.reset()
    assert same(observations, 1, alone)
    assert not rewards.any() and not terminated.any() and "pick" not in infos
    images = envs.render()
    assert isinstance(images, tuple) and isinstance(images[0], np.ndarray) and images[0].shape == (48, 64, 3)
    single.close()


@pytest.mark.render
def test_some_environments_are_reset_and_the_others_keep_their_truth(envs) -> None:
    envs.reset(seed=[7, 8])
    kept = envs.truth(1)
    options = {"reset_mask": np.array([True, False])}
    envs.reset(seed=[8, None], options=options)
    assert "reset_mask" in options
    assert envs.truth(1) is kept
    np.testing.assert_array_equal(envs.truth(0)[0].T_world_part, kept[0].T_world_part)


@pytest.mark.render
def test_a_dead_worker_is_named_and_ends_the_whole() -> None:
    envs = BinPickVectorEnv(2, scene_config=CONFIG)
    with pytest.raises(ConfigError, match=r"environment 0 has no scene yet: call reset\(\) first"):
        envs.truth(0)
    envs.reset(seed=0)
    pid = envs.processes[1].pid
    assert pid is not None
    os.kill(pid, signal.SIGKILL)
    with pytest.raises(WorkerDiedError, match=r"environment 1 with exit code -9\. A negative code .* memory"):
        envs.step(IDLE)
        envs.step(IDLE)
    assert envs.closed and not any(process.is_alive() for process in envs.processes)
    envs.close()
    with pytest.raises(gymnasium.error.ClosedEnvironmentError):
        envs.step(IDLE)


@pytest.mark.render
def test_a_worker_s_error_comes_as_it_was_and_closing_twice_is_harmless() -> None:
    envs = BinPickVectorEnv(1, scene_config=CONFIG, autoreset_mode="Disabled")
    copy_of_settings = pickle.dumps(envs)
    with pytest.raises(ConfigError, match=r"unknown reset options \['colour'\]; valid: scene_file"):
        envs.reset(options={"colour": 1})
    assert envs.closed
    again = pickle.loads(copy_of_settings)
    assert again.metadata["autoreset_mode"] is AutoresetMode.DISABLED and again.scene_config == CONFIG
    os.kill(again.processes[0].pid, signal.SIGKILL)
    again.close()
    again.close()


@pytest.mark.parametrize(
    ("arguments", "error", "text"),
    [
        ({"num_envs": 0}, ConfigError, "num_envs must be an integer of 1 or more, got 0"),
        (
            {"max_concurrency": 0},
            ConfigError,
            "max_concurrency must be an integer of 1 or more, or None .*, got 0",
        ),
        ({"autoreset_mode": "never"}, ConfigError, "must be one of NextStep, SameStep, Disabled, got 'never'"),
        ({"parts": ["nonsense"]}, UnknownPartError, "no part named 'nonsense'"),
        ({"max_picks": 0}, ConfigError, "max_picks must be an integer of 1 or more, or None for no limit, got 0"),
    ],
)
def test_bad_arguments_are_refused_before_a_process_starts(arguments, error, text) -> None:
    with pytest.raises(error, match=text):
        BinPickVectorEnv(**arguments)
