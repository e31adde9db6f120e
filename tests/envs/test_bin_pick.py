"""`simpick/BinPick-v0` behaves as users of gymnasium expect."""

import pickle
import subprocess
import sys
from collections.abc import Callable

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import simpick  # noqa: F401 - registers the environments
from simpick.envs.actions import ABSTAIN, encode_action
from simpick.envs.bin_pick import BinPickEnv
from simpick.envs.spaces import OUTCOMES, outcome_from_index, outcome_index
from simpick.errors import ConfigError, UnknownPartError
from simpick.geometry import transform
from simpick.records import PickOutcome, PickResult

pytestmark = pytest.mark.render


def same_observations(a: dict, b: dict) -> bool:
    return a.keys() == b.keys() and all(np.array_equal(a[key], b[key]) for key in a)


def test_gymnasium_accepts_it() -> None:
    env = gymnasium.make("simpick/BinPick-v0", count=2, render_mode="rgb_array")
    check_env(env.unwrapped)
    env.close()


def test_reset_reports_success_and_truth(opened) -> None:
    env = opened(BinPickEnv(count=3))
    observation, info = env.reset(seed=1)
    assert info["is_success"] is False
    assert info["truth"]["T_world_part"].shape == (3, 4, 4) and info["truth"]["in_bin"].all()
    assert observation["remaining"] == 3 and observation["last_outcome"] == 0


def test_every_part_is_seen_and_named(opened) -> None:
    env = opened(BinPickEnv(parts=["hex_bolt", "pipe_tee"], count=4))
    observation, _ = env.reset(seed=2)
    assert set(np.unique(observation["segmentation"])) == {0, 1, 2, 3, 4}
    names = [env.part_names[k] for k in observation["instance_parts"] if k >= 0]
    assert names == [instance.part.name for instance in env.scene.instances]


def test_observations_share_no_memory(opened) -> None:
    env = opened(BinPickEnv(count=2))
    first, _ = env.reset(seed=0)
    kept = {key: np.array(value, copy=True) for key, value in first.items()}
    second, *_ = env.step(ABSTAIN)
    assert not any(np.shares_memory(first[key], second[key]) for key in ("rgb", "depth", "segmentation"))
    env.step(ABSTAIN)
    assert same_observations(first, kept)


def test_abstaining_twice_ends_the_episode(opened) -> None:
    env = opened(BinPickEnv(count=2))
    env.reset(seed=0)
    _, reward, terminated, truncated, info = env.step(ABSTAIN)
    assert (reward, terminated, truncated) == (-0.1, False, False)
    assert info["pick"].outcome is PickOutcome.NO_GRASP
    observation, _, terminated, _, info = env.step(ABSTAIN)
    assert terminated and info["ended"] == "consecutive_failures"
    assert outcome_from_index(int(observation["last_outcome"])) is PickOutcome.NO_GRASP


def test_max_picks_truncates(opened) -> None:
    env = opened(BinPickEnv(count=2, max_picks=1))
    env.reset(seed=0)
    _, _, terminated, truncated, info = env.step(ABSTAIN)
    assert (terminated, truncated, info["ended"]) == (False, True, "max_picks")


def results(env: BinPickEnv, monkeypatch, *outcomes: PickResult) -> Callable[[], tuple]:
    """Return a function that steps the environment, whose picks end like these in turn."""
    left = iter(outcomes)
    monkeypatch.setattr(env._executor, "execute", lambda *command: next(left))
    action = encode_action(transform(np.diag([1.0, -1.0, -1.0]), np.array([0.5, 0, 0.05])), 0.05, env.workspace)
    return lambda: env.step(action)[1:]


MISSED = PickResult(PickOutcome.MISSED, "closed on nothing")
DELIVERED = PickResult(PickOutcome.SUCCESS, "delivered", delivered=(0,))
COLLIDED = PickResult(PickOutcome.COLLISION, "pressed on the floor")


def test_rewards_are_per_part_delivered_less_the_costs_of_failures_and_collisions(opened, monkeypatch) -> None:
    env = opened(BinPickEnv(count=2, max_consecutive_failures=9))
    env.reset(seed=0)
    pair = PickResult(PickOutcome.DOUBLE_PICK, "together", delivered=(0, 1))
    step = results(env, monkeypatch, DELIVERED, pair, MISSED, COLLIDED)
    assert [step()[0] for _ in range(4)] == pytest.approx([1.0, 2.0, -0.1, -0.2])


def test_only_failures_in_a_row_end_the_episode(opened, monkeypatch) -> None:
    env = opened(BinPickEnv(count=2))
    env.reset(seed=0)
    step = results(env, monkeypatch, MISSED, DELIVERED, COLLIDED, MISSED)
    steps = [step() for _ in range(4)]
    assert [(terminated, info["ended"]) for _, terminated, _, info in steps] == [
        *[(False, "")] * 3,
        (True, "consecutive_failures"),
    ]
    assert [info["pick"].pick for *_, info in steps] == [0, 1, 2, 3]
    env.reset(seed=0)
    _, _, terminated, _, info = env.step(ABSTAIN)
    assert (terminated, info["pick"].pick) == (False, 0), "a new episode counts from the start"


def test_an_episode_that_terminates_is_not_truncated_too(opened) -> None:
    env = opened(BinPickEnv(count=2, max_picks=2))
    env.reset(seed=0)
    env.step(ABSTAIN)
    _, _, terminated, truncated, info = env.step(ABSTAIN)
    assert (terminated, truncated, info["ended"]) == (True, False, "consecutive_failures")


def test_same_seed_is_the_same_bin_in_another_process() -> None:
    code = (
        "import hashlib; from simpick.envs.bin_pick import BinPickEnv; env = BinPickEnv(count=3);"
        "o, i = env.reset(seed=5); print(hashlib.sha256(o['rgb'].tobytes() + o['depth'].tobytes()"
        " + i['truth']['T_world_part'].tobytes()).hexdigest())"
    )
    runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True) for _ in range(2)]
    assert runs[0].stdout == runs[1].stdout and len(runs[0].stdout.strip()) == 64


def test_reset_without_seed_goes_on_to_another_bin(opened) -> None:
    env = opened(BinPickEnv(count=2))
    _, first = env.reset(seed=5)
    _, second = env.reset()
    assert not np.array_equal(first["truth"]["T_world_part"], second["truth"]["T_world_part"])


def test_it_pickles(opened) -> None:
    env = opened(BinPickEnv(count=2, gripper="suction", max_picks=3))
    a, _ = env.reset(seed=4)
    copy = pickle.loads(pickle.dumps(env))
    b, _ = copy.reset(seed=4)
    assert same_observations(a, b)
    copy.close()


def test_async_vector_environments_work() -> None:
    envs = gymnasium.make_vec(
        "simpick/BinPick-v0", num_envs=2, vectorization_mode="async", vector_kwargs={"context": "spawn"}, count=2
    )
    observation, _ = envs.reset(seed=[1, 2])  # pyright: ignore[reportArgumentType] - gymnasium takes a list
    assert observation["rgb"].shape == (2, 480, 640, 3)
    _, reward, *_ = envs.step(np.stack([ABSTAIN, ABSTAIN]))
    assert reward.tolist() == [-0.1, -0.1]
    envs.close()


def test_closing_twice_is_harmless() -> None:
    env = BinPickEnv(count=1)
    env.reset(seed=0)
    env.close()
    env.close()
    with pytest.raises(ConfigError, match=r"call reset\(\) first"):
        env.truth()


@pytest.mark.parametrize("closed", [False, True])
def test_a_step_without_a_scene_is_refused(closed: bool) -> None:
    env = BinPickEnv(parts=["hex_nut"], count=1)
    if closed:
        env.reset(seed=0)
        env.close()
    action = encode_action(transform(np.diag([1.0, -1.0, -1.0]), np.array([0.5, 0, 0.05])), 0.05, env.workspace)
    for command in (ABSTAIN, action):
        with pytest.raises(ConfigError, match=r"has no scene yet: call reset\(\) first"):
            env.step(command)
    env.close()


def test_a_loaded_scene_that_does_not_fit_the_environment_is_refused(opened, tmp_path) -> None:
    env = opened(BinPickEnv(parts=["hex_nut"], count=1))
    env.reset(seed=0)
    env.scene.save(tmp_path / "bin.npz")
    for other in (BinPickEnv(parts=["bushing"], count=1), BinPickEnv(parts=["hex_nut"], gripper="suction")):
        with pytest.raises(ConfigError, match=r"a loaded scene must have .* parts, got others; .*Scene\.load"):
            other.reset(options={"scene_file": tmp_path / "bin.npz"})
        with pytest.raises(ConfigError, match=r"call reset\(\) first"):
            other.step(ABSTAIN)


def test_saved_scenes_come_back(opened, tmp_path) -> None:
    env = opened(BinPickEnv(count=2))
    a, _ = env.reset(seed=6)
    env.scene.save(tmp_path / "bin.npz")
    b, _ = env.reset(options={"scene_file": tmp_path / "bin.npz"})
    assert same_observations(a, b)
    with pytest.raises(ConfigError, match=r"unknown reset options \['scenefile'\]; valid: scene_file"):
        env.reset(options={"scenefile": "x"})


def test_frames_of_a_motion_come_as_a_list(opened) -> None:
    env = opened(BinPickEnv(count=1, render_mode="rgb_array_list"))
    env.reset(seed=0)
    frames = env.render()
    assert len(frames) == 1 and frames[0].shape == (480, 640, 3) and frames[0].std() > 10


@pytest.mark.parametrize(
    ("arguments", "error", "text"),
    [
        ({"parts": ["hex_bolt", "nonsense"]}, UnknownPartError, "no part named 'nonsense'. Valid: .*hex_bolt"),
        ({"count": 0}, ConfigError, "count must be between 1 and 50, got 0"),
        ({"count": 500}, ConfigError, "count must be between 1 and 50, got 500"),
        *(
            ({name: value}, ConfigError, f"{name} must be an integer of 1 or more.*, got {value!r}")
            for name in ("max_picks", "max_consecutive_failures")
            for value in (True, -1, 0)
        ),
        ({"render_mode": "human"}, ConfigError, "render_mode must be None or one of rgb_array, rgb_array_list"),
    ],
)
def test_bad_arguments_are_refused_before_anything_is_simulated(arguments, error, text) -> None:
    with pytest.raises(error, match=text):
        BinPickEnv(**arguments)


def test_outcomes_are_numbered_both_ways() -> None:
    assert [outcome_from_index(outcome_index(o)) for o in (None, *OUTCOMES)] == [None, *OUTCOMES]


def test_a_scene_that_blows_up_ends_as_a_fault_and_the_next_one_is_valid(opened, capfd) -> None:
    env = opened(BinPickEnv(count=2))
    env.reset(seed=0)
    env.scene.data.qvel[:] = 1e7
    T_world_tcp = transform(np.diag([1.0, -1.0, -1.0]), np.array([0.5, 0.0, 0.05]))
    observation, _, terminated, _, info = env.step(encode_action(T_world_tcp, 0.05, env.workspace))
    assert terminated and info["ended"] == "simulation_fault"
    assert info["pick"].outcome is PickOutcome.SIMULATION_FAULT and "diverged" in info["pick"].cause
    assert observation in env.observation_space
    observation, info = env.reset(seed=0)
    assert observation["remaining"] == 2 and not info["is_success"]
    capfd.readouterr()  # MuJoCo warns on the terminal; that is expected here.


def test_a_name_where_a_list_is_meant_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"parts must be a list of names or mesh files, got 'hex_bolt'; write \['hex"):
        BinPickEnv(parts="hex_bolt")
