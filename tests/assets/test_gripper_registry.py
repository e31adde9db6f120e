from importlib.metadata import EntryPoint

import pytest

from simpick.assets.grippers import Gripper, JawGripper, get_gripper, registry
from simpick.envs.actions import encode_action
from simpick.envs.bin_pick import ABSTAINED, BinPickEnv
from simpick.errors import ConfigError, UnknownNameError
from simpick.geometry import transform
from simpick.grasping import GraspPlanner
from simpick.motion import PickExecutor
from simpick.scene import BinConfig


class SlowJaw(JawGripper):
    name = "slow_jaw"
    loaded_acceleration = 0.2


class WideJaw(JawGripper):
    name = "wide_jaw"
    max_opening_m = 0.14


class Hook:
    name = "hook"


@pytest.fixture(autouse=True)
def entry_points(monkeypatch: pytest.MonkeyPatch) -> None:
    entries = [
        EntryPoint("slow_jaw", f"{__name__}:SlowJaw", registry.ENTRY_POINT_GROUP),
        EntryPoint("wide_jaw", f"{__name__}:WideJaw", registry.ENTRY_POINT_GROUP),
        EntryPoint("hook", f"{__name__}:Hook", registry.ENTRY_POINT_GROUP),
        EntryPoint("fast_jaw", f"{__name__}:SlowJaw", registry.ENTRY_POINT_GROUP),
    ]
    monkeypatch.setattr(registry, "entry_points", lambda group: entries)


@pytest.mark.parametrize("name", registry.GRIPPERS)
def test_a_shipped_gripper_knows_its_name_and_implements_the_interface(name: str) -> None:
    gripper = get_gripper(name)
    assert isinstance(gripper, Gripper) and gripper.name == name


def test_another_packages_gripper_works_by_its_name_everywhere() -> None:
    env = BinPickEnv(parts=("bushing",), count=1, gripper="slow_jaw")
    env.reset(seed=0)
    assert isinstance(env.scene.gripper, SlowJaw)
    env.close()
    assert isinstance(GraspPlanner("slow_jaw", BinConfig()).gripper, SlowJaw)


def test_a_gripper_opens_as_wide_as_it_can(monkeypatch: pytest.MonkeyPatch) -> None:
    env = BinPickEnv(parts=("bushing",), count=1, gripper="wide_jaw")
    env.reset(seed=0)
    commanded = []
    monkeypatch.setattr(PickExecutor, "execute", lambda self, T, opening_m: commanded.append(opening_m) or ABSTAINED)
    env.step(encode_action(transform(translation=env.workspace.centre_m), 0.12, env.workspace, 0.14))
    env.close()
    assert commanded == pytest.approx([0.12])


def test_an_unknown_name_lists_those_that_exist() -> None:
    with pytest.raises(
        UnknownNameError, match=r"no gripper named 'claw'\. Valid: fast_jaw, hook, jaw, slow_jaw, suc.*, wide_"
    ):
        get_gripper("claw")


def test_an_incomplete_gripper_is_refused_with_what_it_lacks() -> None:
    with pytest.raises(ConfigError, match=r"gripper 'hook' of .*:Hook must be a .*, it lacks tcp_site, .* boxes"):
        BinPickEnv(gripper="hook")


def test_a_gripper_of_another_name_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"gripper 'fast_jaw' of .*SlowJaw must .*, its name is 'slow_jaw'"):
        get_gripper("fast_jaw")
