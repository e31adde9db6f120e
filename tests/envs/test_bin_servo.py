"""`simpick/BinServo-v0` moves as commanded, observes what it should, and ends when the work is done."""

import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env

import simpick  # noqa: F401 - registers the environments
from simpick.envs.bin_servo import COLLISION_COST, BinServoEnv
from simpick.envs.servo_spaces import MAX_ANGULAR_SPEED_RAD_S, MAX_LINEAR_SPEED_M_S, SERVO_WORKSPACE
from simpick.errors import ConfigError
from simpick.geometry import so3_log, transform
from simpick.scene.workspace import CHUTE_CENTRE_M

HOLD = np.zeros(7, np.float32)
IN_BIN = np.array([0.50, 0.05, 0.0])


def blind(count: int = 1, gripper: str = "jaw", **arguments) -> BinServoEnv:
    """Return an environment without images: its steps cost milliseconds."""
    part = "bushing" if gripper == "jaw" else "terminal_block"
    return BinServoEnv(parts=(part,), count=count, gripper=gripper, images=(), randomization="none", **arguments)


def moved(env: BinServoEnv, action, ticks: int) -> dict:
    """Apply an action for some ticks and return the last observation."""
    observation = {}
    for _ in range(ticks):
        observation, *_ = env.step(np.asarray(action, np.float32))
    return observation


def stand(env: BinServoEnv, place: np.ndarray, instance: int = 0) -> None:
    """Put a part upright at a place on the bin's floor."""
    height = env.scene.instances[instance].part.extents_m[2]
    env.scene.place({instance: transform(translation=place + np.array([0, 0, height / 2 + 0.0005]))})


def steer(env: BinServoEnv, target: np.ndarray, gripper: float = 0.0, ticks: int = 120) -> list:
    """Drive the TCP to a point as a teleoperator would; return the last step's answer."""
    answer: list = []
    for _ in range(ticks):
        away = target - env.scene.data.site("gripper/tcp").xpos
        if np.linalg.norm(away) < 0.002:
            break
        action = np.zeros(7)
        action[:3] = np.clip(8 * away / MAX_LINEAR_SPEED_M_S, -1, 1)
        action[6] = gripper
        answer = list(env.step(action))
    return answer


# -- the contract of gymnasium --------------------------------------------------------------------------------------


@pytest.mark.render
def test_gymnasium_accepts_it() -> None:
    env = gymnasium.make(
        "simpick/BinServo-v0", parts=("hex_nut",), count=1, image_size=(48, 32), render_mode="rgb_array"
    )
    check_env(env.unwrapped)
    env.close()


@pytest.mark.render
def test_images_are_as_asked_for_and_share_no_memory(opened) -> None:
    env = opened(BinServoEnv(parts=("hex_nut",), count=1, image_size=(64, 48)))
    first, _ = env.reset(seed=0)
    assert first["overhead"].shape == first["wrist"].shape == (48, 64, 3)
    kept = {key: np.array(value, copy=True) for key, value in first.items()}
    second = moved(env, [1, 1, 0, 0, 0, 1, 0], 3)
    assert not any(np.shares_memory(first[key], second[key]) for key in first if key != "remaining")
    assert all(np.array_equal(first[key], kept[key]) for key in first)
    assert not np.array_equal(first["wrist"], second["wrist"])
    only = BinServoEnv(parts=("hex_nut",), count=1, images=("wrist",), image_size=(64, 48))
    observation, _ = only.reset(seed=0)
    assert "overhead" not in observation and observation["wrist"].std() > 5
    only.close()


@pytest.mark.render
def test_same_seed_and_actions_give_the_same_observations_also_after_pickling(opened) -> None:
    env = opened(BinServoEnv(parts=("hex_nut",), count=2, image_size=(48, 32)))
    copy = pickle.loads(pickle.dumps(env))
    actions = np.random.default_rng(0).uniform(-1, 1, (5, 7))
    runs = []
    for each in (env, copy, env):
        seen = [each.reset(seed=3)[0], *(each.step(action)[0] for action in actions)]
        runs.append([np.concatenate([np.ravel(v).astype(float) for v in o.values()]) for o in seen])
    np.testing.assert_array_equal(runs[0], runs[1])
    np.testing.assert_array_equal(runs[0], runs[2])
    copy.close()


@pytest.mark.render
def test_frames_of_a_tick_come_as_a_list(opened) -> None:
    env = opened(blind(render_mode="rgb_array_list"))
    env.reset(seed=0)
    env.render()
    env.step(HOLD)
    frames = env.render()
    assert 1 <= len(frames) <= 3 and frames[-1].shape == (480, 640, 3)


def test_closing_twice_is_harmless() -> None:
    env = blind()
    env.reset(seed=0)
    env.close()
    env.close()
    with pytest.raises(ConfigError, match=r"call reset\(\) first"):
        env.step(HOLD)


def test_reset_reports_success_and_truth(opened) -> None:
    env = opened(blind(count=2))
    observation, info = env.reset(seed=1)
    assert info["is_success"] is False and info["truth"]["in_bin"].tolist() == [True, True]
    assert observation["remaining"] == 2
    assert observation["gripper_opening"] == pytest.approx(0.085, abs=1e-4)
    assert isinstance(env.observation_space, spaces.Dict)
    assert set(env.observation_space.spaces) == set(observation)


def test_max_ticks_truncates(opened) -> None:
    env = opened(blind(max_ticks=2))
    env.reset(seed=0)
    assert env.step(HOLD)[2:4] == (False, False)
    _, _, terminated, truncated, info = env.step(HOLD)
    assert (terminated, truncated, info["ended"]) == (False, True, "max_ticks")


def test_an_episode_that_terminates_is_not_truncated_too(opened) -> None:
    env = opened(BinServoEnv(parts=("bushing",), count=1, images=(), max_ticks=1))
    env.reset(seed=0)
    env.scene.place({0: transform(translation=np.array([*CHUTE_CENTRE_M[:2], 0.02]))})
    _, _, terminated, truncated, info = env.step(HOLD)
    assert (terminated, truncated, info["ended"]) == (True, False, "cleared")


def test_vector_environments_go_on_when_one_has_delivered_a_part() -> None:
    envs = gymnasium.make_vec(
        "simpick/BinServo-v0", num_envs=2, vectorization_mode="sync", parts=("bushing",), count=2, images=()
    )
    assert isinstance(envs, gymnasium.vector.SyncVectorEnv)
    envs.reset(seed=[1, 2])
    first = envs.envs[0].unwrapped
    assert isinstance(first, BinServoEnv)
    chute = transform(translation=np.array([*CHUTE_CENTRE_M[:2], 0.02]))
    first.scene.place({0: chute})
    _, rewards, _, _, info = envs.step(np.zeros((2, 7), np.float32))
    assert rewards.tolist() == [1.0, 0.0] and info["delivered"].tolist() == [(0,), ()]
    lost = np.isnan(info["truth"]["T_world_part"]).all(axis=(2, 3))
    assert lost.tolist() == [[True, False], [False, False]]
    envs.close()


# -- motion ---------------------------------------------------------------------------------------------------------


def test_half_speed_upwards_for_a_second_raises_the_tcp_by_that_much(opened) -> None:
    env = opened(blind())
    start, _ = env.reset(seed=0)
    moved(env, 0.5 * np.eye(7)[2], 20)
    end = moved(env, HOLD, 2)
    shift = end["T_world_tcp"][:3, 3] - start["T_world_tcp"][:3, 3]
    np.testing.assert_allclose(shift, [0, 0, 0.5 * MAX_LINEAR_SPEED_M_S], atol=0.002)
    turn = so3_log((end["T_world_tcp"][:3, :3] @ start["T_world_tcp"][:3, :3].T).astype(float))
    assert np.linalg.norm(turn) < 0.005


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_turning_about_a_world_axis_turns_about_the_tcp(opened, axis: int) -> None:
    env = opened(blind())
    start, _ = env.reset(seed=0)
    moved(env, 0.5 * np.eye(7)[3 + axis], 20)
    end = moved(env, HOLD, 2)
    turn = so3_log((end["T_world_tcp"][:3, :3] @ start["T_world_tcp"][:3, :3].T).astype(float))
    np.testing.assert_allclose(turn, 0.5 * MAX_ANGULAR_SPEED_RAD_S * np.eye(3)[axis], atol=0.01)
    np.testing.assert_allclose(end["T_world_tcp"][:3, 3], start["T_world_tcp"][:3, 3], atol=0.003)


def test_zeros_hold_the_arm_still(opened) -> None:
    env = opened(blind())
    start, _ = env.reset(seed=0)
    end = moved(env, HOLD, 20)
    np.testing.assert_allclose(end["T_world_tcp"], start["T_world_tcp"], atol=2e-4)


@pytest.mark.parametrize(("turning", "beyond_m"), [(0.0, 0.010), (1.0, 0.030)])
def test_the_tcp_stays_in_its_workspace(opened, turning: float, beyond_m: float) -> None:
    # Over the bin: where the arm goes that it blocks, depends on the contact.
    env = opened(blind())
    env.reset(seed=0)
    rng = np.random.default_rng(1)
    for corner in ([1, 1, 1], [-1, -1, 1], [1, -1, 1], [-1, 1, 1]):
        for _ in range(50):
            observation, *_ = env.step(np.concatenate([corner, turning * rng.uniform(-1, 1, 3), [0.0]]))
            position = observation["T_world_tcp"][:3, 3].astype(float)
            assert np.all(position > np.array(SERVO_WORKSPACE.lower_m) - beyond_m)
            assert np.all(position < np.array(SERVO_WORKSPACE.upper_m) + beyond_m)


def test_pressing_on_the_bin_costs_and_ends_as_soon_as_the_arm_turns_back(opened) -> None:
    env = opened(blind())
    env.reset(seed=0)
    stand(env, np.array([0.60, 0.15, 0.0]))
    steer(env, np.array([0.45, -0.05, 0.10]))
    rewards = [env.step(np.array([0.0, 0, -1, 0, 0, 0, 0])) for _ in range(40)]
    assert rewards[-1][1] == pytest.approx(-COLLISION_COST) and rewards[-1][4]["collision"]
    low = rewards[-1][0]["T_world_tcp"][2, 3]
    assert moved(env, [0, 0, 0.8, 0, 0, 0, 0], 6)["T_world_tcp"][2, 3] > low + 0.03
    *_, info = env.step(HOLD)
    assert not info["collision"]


# -- gripper --------------------------------------------------------------------------------------------------------


def test_the_jaw_closes_holds_and_opens_on_command(opened) -> None:
    env = opened(blind())
    env.reset(seed=0)
    half = moved(env, [0, 0, 0, 0, 0, 0, 1], 5)["gripper_opening"].item()
    assert 0.03 < half < 0.06
    assert moved(env, HOLD, 5)["gripper_opening"].item() == pytest.approx(half, abs=0.005)
    assert moved(env, [0, 0, 0, 0, 0, 0, 1], 12)["gripper_opening"].item() < 0.001
    assert moved(env, [0, 0, 0, 0, 0, 0, -1], 14)["gripper_opening"].item() > 0.084


def test_a_teleoperated_jaw_delivers_the_only_part_and_succeeds(opened) -> None:
    env = opened(blind())
    env.reset(seed=0)
    stand(env, IN_BIN)
    above, chute = np.array([0, 0, 0.25]), np.array([*CHUTE_CENTRE_M[:2], 0.25])
    steer(env, IN_BIN + above)
    steer(env, IN_BIN + np.array([0, 0, 0.015]))
    moved(env, [0, 0, 0, 0, 0, 0, 1], 12)
    observation, _, terminated, _, _ = steer(env, IN_BIN + above)
    # The last part is out of the bin, but in the gripper: the work is not done.
    assert observation["remaining"] == 0 and not terminated
    steer(env, chute)
    reward, truncated, info = 0.0, False, {}
    for _ in range(40):
        _, reward, terminated, truncated, info = env.step(np.array([0.0, 0, 0, 0, 0, 0, -1]))
        if terminated:
            break
    assert (reward, terminated, truncated) == (1.0, True, False)
    assert (info["delivered"], info["ended"], info["is_success"]) == ((0,), "cleared", True)
    assert env.scene.removed == (0,)


def test_a_suction_cup_seals_while_vacuum_is_on(opened) -> None:
    env = opened(blind(gripper="suction"))
    observation, _ = env.reset(seed=0)
    assert observation in env.observation_space and "gripper_opening" not in observation
    stand(env, IN_BIN)
    top = IN_BIN + np.array([0, 0, env.scene.instances[0].part.extents_m[2]])
    steer(env, top + np.array([0, 0, 0.05]))
    assert steer(env, top - np.array([0, 0, 0.004]), gripper=1.0)[0]["suction_sealed"].tolist() == [1]
    observation = steer(env, top + np.array([0, 0, 0.10]))[0]
    assert observation["suction_sealed"].tolist() == [1] and observation["remaining"] == 1
    assert env.scene.T_world_part(0)[2, 3] > 0.08
    assert moved(env, [0, 0, 0, 0, 0, 0, -1], 1)["suction_sealed"].tolist() == [0]


# -- ends and errors ------------------------------------------------------------------------------------------------


def test_a_bin_whose_parts_lie_on_the_table_is_cleared_without_success(opened) -> None:
    env = opened(blind())
    env.reset(seed=0)
    stand(env, np.array([0.9, 0.5, -0.008]))
    reward, terminated, info = 0.0, False, {}
    for _ in range(40):
        _, reward, terminated, _, info = env.step(HOLD)
        if terminated:
            break
    assert terminated and (info["ended"], info["is_success"], reward) == ("cleared", False, 0.0)


@pytest.mark.parametrize("speed_m_s", [1e6, np.nan])
@pytest.mark.parametrize("on_tick", [None, lambda scene: None])
def test_diverged_physics_end_the_episode_on_the_last_observation(opened, speed_m_s: float, on_tick) -> None:
    env = opened(blind())
    env.reset(seed=0)
    env.on_tick = on_tick
    before = moved(env, HOLD, 1)
    env.scene.data.qvel[env.scene.instances[0].dof_adr] = speed_m_s
    observation, _, terminated, _, info = env.step(HOLD)
    assert terminated and info["ended"] == "simulation_fault"
    assert all(np.array_equal(observation[key], before[key]) for key in before)


def test_watching_every_period_changes_nothing_and_shows_poses_that_are_up_to_date(opened) -> None:
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (20, 7))
    env = opened(blind(count=3))
    env.reset(seed=0)
    unwatched = [env.step(action) for action in actions]
    lag_m: list[float] = []
    env.reset(seed=0)
    env.on_tick = lambda scene: lag_m.append(np.abs(scene.Ts_world_part()[:, :3, 3] - scene.positions_m).max())
    watched = [env.step(action) for action in actions]
    assert len(lag_m) == 5 * len(actions) and max(lag_m) < 1e-12
    for (one, *_, truth), (other, *_, other_truth) in zip(unwatched, watched, strict=True):
        assert all(np.array_equal(one[key], other[key]) for key in one)
        np.testing.assert_array_equal(truth["truth"]["T_world_part"], other_truth["truth"]["T_world_part"])


def test_a_saved_scene_comes_back_and_one_of_another_gripper_is_refused(opened, tmp_path) -> None:
    env = opened(blind(count=2))
    _, info = env.reset(seed=6)
    env.scene.save(tmp_path / "bin.npz")
    _, again = env.reset(options={"scene_file": tmp_path / "bin.npz"})
    np.testing.assert_array_equal(info["truth"]["T_world_part"], again["truth"]["T_world_part"])
    other = blind(gripper="suction")
    with pytest.raises(ConfigError, match="a loaded scene must have this environment's gripper and image sizes"):
        other.reset(options={"scene_file": tmp_path / "bin.npz"})


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"images": ("overhead", "side")}, "images must be distinct names out of overhead, wrist"),
        ({"images": "wrist"}, "images must be distinct names out of overhead, wrist, or .*got 'wrist'"),
        ({"image_size": (8, 8)}, "width_px must be between 16 and 4096, got 8"),
        ({"max_ticks": 0}, "max_ticks must be an integer of 1 or more, or None for no limit, got 0"),
        ({"render_mode": "human"}, "render_mode must be None or one of rgb_array, rgb_array_list"),
        ({"count": 0}, "count must be between 1 and 50, got 0"),
    ],
)
def test_bad_arguments_are_refused(arguments: dict, text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        BinServoEnv(**arguments)


@pytest.mark.parametrize("action", [np.zeros(6), np.array([0, 0, np.nan, 0, 0, 0, 0])])
def test_bad_actions_are_refused(action: np.ndarray) -> None:
    env = blind()
    env.reset(seed=0)
    with pytest.raises(ConfigError, match="an action must be 7 finite numbers"):
        env.step(action)
