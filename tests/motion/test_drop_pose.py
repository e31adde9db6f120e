"""What the planner remembers of the poses over the chute changes none of its answers."""

import numpy as np

from simpick.motion import MotionConfig
from simpick.motion.planner import PickPlanner
from simpick.scene import SceneConfig


def test_an_answer_does_not_depend_on_those_before_it() -> None:
    config, rng = SceneConfig(), np.random.default_rng(0)
    planner = PickPlanner(config, MotionConfig())
    home = planner.robot.home_qpos
    starts = [home + rng.uniform(-0.6, 0.6, len(home)) for _ in range(12)]
    first = [planner.drop_pose(q) for q in starts]
    again = [planner.drop_pose(q) for q in reversed(starts)][::-1]
    fresh = [PickPlanner(config, MotionConfig()).drop_pose(q) for q in starts[:3]]
    for q, one, other in zip(starts, first, again, strict=True):
        np.testing.assert_array_equal(one, other)
        T_world_tcp, _ = planner._drops[0]
        known = {}
        for solution in planner.kinematics.solve_all(T_world_tcp, q, known):
            solution += 1.0  # An answer is the caller's own.
        same = zip(
            planner.kinematics.solve_all(T_world_tcp, q, known),
            planner.kinematics.solve_all(T_world_tcp, q),
            strict=True,
        )
        for remembered, solved in same:
            np.testing.assert_array_equal(remembered, solved)
    for one, other in zip(first[:3], fresh, strict=True):
        np.testing.assert_array_equal(one, other)


def test_few_solutions_are_remembered() -> None:
    planner, rng = PickPlanner(SceneConfig(), MotionConfig()), np.random.default_rng(0)
    for _ in range(60):
        planner.drop_pose(planner.robot.home_qpos + rng.uniform(-1.5, 1.5, len(planner.robot.home_qpos)))
    assert max(len(known) for _, known in planner._drops) <= 200
