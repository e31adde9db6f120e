"""Picks in the simulator: every outcome is provoked and must be reported with its cause."""

import numpy as np
import pytest

from simpick.errors import ConfigError
from simpick.geometry.transforms import so3_exp, transform
from simpick.motion import MotionConfig, PickExecutor
from simpick.motion.planner import NoPlan, PickPlanner
from simpick.records import PickOutcome
from simpick.scene import Scene, SceneConfig, build_scene

DOWN = np.diag([1.0, -1.0, -1.0])
PLACE = np.array([0.52, 0.05, 0.0])


def _tcp(x=PLACE[0], y=PLACE[1], z=0.015, yaw=0.0) -> np.ndarray:
    return transform(DOWN @ so3_exp(np.array([0.0, 0.0, yaw])), np.array([x, y, z]))


def _scene(gripper="jaw", count=2, part="bushing") -> Scene:
    """Return a bin whose first part stands at PLACE and whose others lie far from it."""
    scene = build_scene(SceneConfig(parts=(part,), count=count, gripper=gripper, randomization="none"), seed=0)
    for k in range(count):
        _stand(scene, k, PLACE if k == 0 else np.array([0.42, -0.15 + 0.06 * k, 0.0]))
    scene.step(100)
    return scene


def _stand(scene: Scene, instance: int, place: np.ndarray) -> None:
    height = scene.instances[instance].part.extents_m[2]
    scene.place({instance: transform(translation=place + np.array([0.0, 0.0, height / 2 + 0.0005]))})


@pytest.fixture(scope="module")
def width() -> float:
    return float(build_scene(SceneConfig(parts=("bushing",), count=1), 0).instances[0].part.extents_m[0])


def test_a_good_grasp_delivers_the_part_and_takes_it_out_of_the_scene(width):
    scene = _scene()
    result = PickExecutor(scene).execute(_tcp(), width + 0.012)
    assert (result.outcome, result.cause) == (PickOutcome.SUCCESS, "part_00 was delivered into the chute")
    assert result.delivered == result.gripped == (0,)
    assert result.ejected == ()
    assert result.stages == ("approach", "descend", "grip", "lift", "carry", "release", "return")
    assert scene.removed == (0,)
    assert scene.parts_in_bin() == (1,)
    assert 3.0 < result.motion_s < 6.5
    assert 5.0 < result.peak_force_n < 120.0


def test_suction_delivers_a_part_by_its_flat_face():
    scene = _scene("suction", part="terminal_block")
    top = scene.T_world_part(0)[2, 3] + scene.instances[0].part.extents_m[2] / 2
    result = PickExecutor(scene).execute(_tcp(z=top), 0.0)
    assert result.outcome is PickOutcome.SUCCESS, result.cause


def test_the_arm_ends_every_pick_at_home(width):
    scene = _scene()
    executor = PickExecutor(scene)
    assert scene.robot is not None
    for x in (0.5, PLACE[0]):
        executor.execute(_tcp(x=x, y=0.05 if x > 0.51 else -0.1), width + 0.012)
        q = scene.data.qpos[[scene.model.joint(f"arm/{name}").qposadr[0] for name in scene.robot.joint_names]]
        assert np.abs(q - scene.robot.home_qpos).max() < 2e-3


def test_the_same_pick_twice_gives_the_same_result_to_the_last_bit(width):
    first, second = _scene(), _scene()
    results = [PickExecutor(scene).execute(_tcp(), width + 0.012) for scene in (first, second)]
    assert results[0] == results[1]
    assert np.array_equal(first.data.qpos, second.data.qpos)


def test_closing_on_nothing_is_missed():
    scene = _scene()
    result = PickExecutor(scene).execute(_tcp(y=-0.02), 0.04)
    assert result.outcome is PickOutcome.MISSED
    assert "nothing between the pads" in result.cause
    assert scene.parts_in_bin() == (0, 1)


def test_a_suction_face_that_finds_no_surface_is_missed():
    result = PickExecutor(_scene("suction")).execute(_tcp(y=-0.02, z=0.03), 0.0)
    assert result.outcome is PickOutcome.MISSED
    assert "found no surface to hold" in result.cause


def test_beyond_reach_is_unreachable_and_the_arm_stays():
    scene = _scene()
    before = scene.time_s
    result = PickExecutor(scene).execute(_tcp(x=1.2), 0.04)
    assert result.outcome is PickOutcome.UNREACHABLE
    assert "no joint angles bring the TCP to (1200, 50, 15) mm" in result.cause
    assert (result.motion_s, result.stages, scene.time_s) == (0.0, (), before)


def test_a_grasp_inside_the_wall_is_unreachable_with_the_wall_named():
    result = PickExecutor(_scene()).execute(_tcp(x=0.645), 0.02)
    assert result.outcome is PickOutcome.UNREACHABLE
    assert "finger would run" in result.cause
    assert "into bin/wall_far" in result.cause


def test_pressing_on_the_bin_is_a_collision_that_retreats(monkeypatch):
    scene = _scene()
    executor = PickExecutor(scene)
    # The planner would refuse; blind it, as a wrongly measured bin would.
    monkeypatch.setattr(executor.planner.collision, "contact", lambda q: None)
    result = executor.execute(_tcp(y=-0.02, z=-0.02), 0.04)
    assert result.outcome is PickOutcome.COLLISION
    assert "at stage descend" in result.cause
    assert "bin/floor" in result.cause
    assert result.stages[-2:] == ("retract", "return")


def test_fingers_that_come_down_on_a_part_are_a_collision():
    scene = _scene(part="keyed_shaft")
    # The shaft stands upright, and the closed fingers come down 40 mm deeper than its end.
    result = PickExecutor(scene).execute(_tcp(z=0.045), 0.0)
    assert result.outcome is PickOutcome.COLLISION
    assert "at stage descend, parts resisted with" in result.cause
    assert 0 in scene.parts_in_bin()


def test_a_part_jammed_on_a_finger_never_spoils_the_next_pick(width):
    scene = _scene()
    executor = PickExecutor(scene)
    # One finger is forced into the bushing's bore: opening the jaw only holds it the faster.
    result = executor.execute(_tcp(x=PLACE[0] + width / 2), 0.03)
    assert result.outcome in (PickOutcome.COLLISION, PickOutcome.EJECTED)
    assert "parts resisted" in result.cause
    assert 0 in scene.parts_in_bin() or scene.removed == (0,)
    place = scene.T_world_part(1)[:2, 3]
    assert executor.execute(_tcp(*place), width + 0.012).outcome is PickOutcome.SUCCESS


def _opening_at(stage: str):
    """Return a callback that makes the jaw fail as soon as `stage` has lasted for 0.35 s."""
    seen = {"ticks": 0}

    def on_step(scene: Scene) -> None:
        assert scene.gripper is not None
        seen["ticks"] += executor_of[id(scene)].stage == stage
        if seen["ticks"] > 35:
            scene.gripper.release(scene.model, scene.data, 0.08)

    executor_of: dict[int, PickExecutor] = {}
    return on_step, executor_of


def _failing_executor(scene: Scene, stage: str) -> PickExecutor:
    on_step, executor_of = _opening_at(stage)
    executor = PickExecutor(scene, on_step)
    executor_of[id(scene)] = executor
    return executor


def test_a_part_lost_inside_the_bin_has_slipped(width):
    scene = _scene()
    result = _failing_executor(scene, "lift").execute(_tcp(), width + 0.012)
    assert result.outcome is PickOutcome.SLIPPED
    assert "part_00 slipped out of the gripper at stage lift" in result.cause
    assert result.gripped == (0,)
    assert 0 in scene.parts_in_bin()


def test_a_part_lost_on_the_way_is_dropped(width):
    scene = _scene()
    result = _failing_executor(scene, "carry").execute(_tcp(), width + 0.012)
    assert result.outcome is PickOutcome.DROPPED
    assert "fell out of the gripper at stage carry" in result.cause


def test_two_parts_between_the_pads_are_a_double_pick(width):
    scene = _scene(count=3)
    for k, offset in ((0, -0.5), (1, 0.5)):
        _stand(scene, k, PLACE + np.array([offset * (width + 0.0006), 0.0, 0.0]))
    scene.step(50)
    result = PickExecutor(scene).execute(_tcp(), 2 * width + 0.012)
    assert result.outcome is PickOutcome.DOUBLE_PICK
    assert result.delivered == (0, 1)


def test_a_part_that_leaves_the_bin_during_a_pick_is_ejected(width):
    scene = _scene()

    def knock_out(scene: Scene) -> None:
        if executor.stage == "carry" and scene.in_bin(1):
            scene.place({1: transform(translation=np.array([0.8, 0.3, 0.05]))})

    executor = PickExecutor(scene, knock_out)
    result = executor.execute(_tcp(), width + 0.012)
    assert result.outcome is PickOutcome.EJECTED
    assert "part_01 left the bin and did not reach the chute; part_00 was delivered" in result.cause
    assert (result.delivered, result.ejected) == ((0,), (1,))


def test_diverging_physics_is_a_simulation_fault_and_no_exception(width):
    scene = _scene()

    def explode(scene: Scene) -> None:
        if executor.stage == "lift":
            scene.data.qvel[scene.instances[1].dof_adr] = 1e4

    executor = PickExecutor(scene, explode)
    result = executor.execute(_tcp(), width + 0.012)
    assert result.outcome is PickOutcome.SIMULATION_FAULT
    assert "diverged" in result.cause
    assert result.delivered == ()


def test_on_step_sees_every_control_period_and_all_stages(width):
    scene = _scene()
    times, stages = [], []

    def watch(scene: Scene) -> None:
        times.append(scene.time_s)
        stages.append(executor.stage)

    executor = PickExecutor(scene, watch)
    result = executor.execute(_tcp(), width + 0.012)
    assert np.allclose(np.diff(times), MotionConfig().control_period_s)
    assert tuple(dict.fromkeys(stages)) == result.stages


def test_a_jaw_takes_whichever_of_its_two_orientations_needs_less_motion():
    planner = PickPlanner(SceneConfig(), MotionConfig())
    for yaw in np.arange(0.0, 2 * np.pi, 0.7):
        plans = [planner.plan(_tcp(yaw=yaw + flip), 0.05) for flip in (0.0, np.pi)]
        assert not any(isinstance(plan, NoPlan) for plan in plans)
        ends = [plan.descent.q_end for plan in plans if not isinstance(plan, NoPlan)]
        assert np.allclose(ends[0], ends[1], atol=1e-3)


def test_motion_config_errors_say_what_to_do():
    with pytest.raises(ConfigError, match=r"tcp_speed_m_s must be above 0, got -1"):
        MotionConfig(tcp_speed_m_s=-1.0)
    with pytest.raises(
        ConfigError, match=r"joint_speed_rad_s must be above 0 and at most 3\.14159, got 9\.0 \(in radians per second"
    ):
        MotionConfig(joint_speed_rad_s=9.0)


def test_a_chute_beyond_reach_is_refused():
    planner = PickPlanner(SceneConfig(), MotionConfig(release_height_m=1.2))
    with pytest.raises(ConfigError, match=r"release_height_m must be a height .* that the arm reaches, got 1\.2"):
        planner.drop_pose(planner.robot.home_qpos)


def test_a_scene_without_an_arm_is_refused():
    scene = build_scene(SceneConfig(parts=("bushing",), count=1, robot=None), seed=0)
    with pytest.raises(ConfigError, match="robot must be the name of an arm to pick, got None"):
        PickExecutor(scene)
