"""What the gripper presses on, and what it does not."""

import mujoco
import pytest

from simpick.recording.contact_force import ContactForce

MODEL = """
<mujoco>
  <option cone="elliptic"/>
  <worldbody>
    <body name="gripper/left"><geom type="box" size="0.05 0.05 0.01" pos="0 0 -0.01"/></body>
    <body name="gripper/right" pos="0 0 0.1"><freejoint/>
      <geom type="box" size="0.02 0.02 0.01" mass="0.5"/></body>
    <body name="part" pos="0 0.2 0.1"><freejoint/><geom type="sphere" size="0.01" mass="0.2"/></body>
    <body name="table" pos="0 0.2 0"><geom type="box" size="0.05 0.05 0.01" pos="0 0 -0.01"/></body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL)


def settled(model: mujoco.MjModel, finger_m: tuple, part_m: tuple) -> mujoco.MjData:
    """Return the state after the loose finger and the part have come to rest from these places."""
    data = mujoco.MjData(model)
    data.qpos[:3], data.qpos[7:10] = finger_m, part_m
    mujoco.mj_step(model, data, 1000)
    return data


def test_fingers_that_touch_each_other_press_on_nothing(model) -> None:
    data = settled(model, (0, 0, 0.012), (0, 0.2, 0.012))
    assert data.ncon > 0
    assert ContactForce(model, "gripper/").newtons(data) == 0.0


def test_a_part_on_a_table_is_not_the_gripper_s(model) -> None:
    data = settled(model, (0, 0.5, 5.0), (0, 0.2, 0.012))
    assert data.ncon > 0
    assert ContactForce(model, "gripper/").newtons(data) == 0.0


def test_a_part_that_lies_on_a_finger_presses_with_its_weight(model) -> None:
    data = settled(model, (0.03, 0, 0.012), (-0.03, 0, 0.012))
    assert ContactForce(model, "gripper/").newtons(data) == pytest.approx(0.2 * 9.81, rel=0.02)


def test_a_model_without_such_a_gripper_has_none(model) -> None:
    assert ContactForce(model, "gripper/").exists
    assert not ContactForce(model, "hand/").exists
