"""The class docstrings of the environments, which the documentation shows, are equal to the spaces and arguments."""

import inspect
import re

import pytest
from gymnasium.spaces import Dict

from simpick.envs import bin_pick, bin_servo, servo_spaces, spaces
from simpick.envs.bin_env import BinEnv
from simpick.envs.bin_pick import BinPickEnv
from simpick.envs.bin_servo import BinServoEnv

ENVS = [BinPickEnv, BinServoEnv]
HEADINGS = [
    "Description",
    "Action Space",
    "Observation Space",
    "Information",
    "Rewards",
    "Starting State",
    "Episode End",
    "Arguments",
    "Version History",
]


def documented(env: type[BinEnv], heading: str) -> str:
    """Return the text under a heading."""
    return (inspect.getdoc(env) or "").partition(f"## {heading}\n")[2].partition("\n## ")[0]


@pytest.mark.parametrize("env", ENVS)
def test_headings_are_gymnasiums_and_in_their_order(env: type[BinEnv]) -> None:
    assert re.findall("^## (.*)$", inspect.getdoc(env) or "", re.MULTILINE) == HEADINGS


def test_the_table_of_actions_is_the_spaces() -> None:
    """A failure shows the table that belongs into the docstring."""
    for env, space, table in (
        (BinPickEnv, spaces.action_space(), spaces.ACTION_TABLE),
        (BinServoEnv, servo_spaces.servo_action_space(), servo_spaces.ACTION_TABLE),
    ):
        text = documented(env, "Action Space")
        assert spaces.action_docs(table) in text
        assert f"`{space}`" in text
        last = int(table[-1].elements.split("-")[-1])
        assert space.shape == (last + 1,)


def test_the_table_of_observations_is_the_spaces() -> None:
    """A failure shows the table that belongs into the docstring."""
    pick, servo = BinPickEnv(), BinServoEnv()
    overhead = pick.scene_config.overhead
    for env, table in (
        (pick, spaces.observation_table(overhead.width_px, overhead.height_px)),
        (servo, servo_spaces.servo_observation_table(servo.scene_config, servo_spaces.IMAGES)),
    ):
        assert env.observation_space == Dict({item.key: item.space for item in table})
        assert spaces.observation_docs(table) in documented(type(env), "Observation Space")


@pytest.mark.parametrize("env", ENVS)
def test_the_table_of_arguments_is_the_signature(env: type[BinEnv]) -> None:
    rows = re.findall(r"^\| `(\w+)` \| `(.*?)` \|", documented(env, "Arguments"), re.MULTILINE)
    defaults = {name: repr(parameter.default) for name, parameter in inspect.signature(env).parameters.items()}
    if env is BinServoEnv:
        assert defaults["image_quality"] == repr(bin_servo.FAST_IMAGES)
        defaults["image_quality"] = "FAST_IMAGES"
    assert dict(rows) == defaults


def test_the_rewards_are_the_constants() -> None:
    pick, servo = documented(BinPickEnv, "Rewards"), documented(BinServoEnv, "Rewards")
    assert f"+{bin_pick.SUCCESS_REWARD:g} per part" in pick and f"-{bin_pick.FAILED_PICK_COST:g} for a pick" in pick
    assert f"another -{bin_pick.COLLISION_COST:g} for a collision" in pick
    assert f"+{bin_servo.DELIVERY_REWARD:g} per part" in servo and f"-{bin_servo.COLLISION_COST:g} per tick" in servo
