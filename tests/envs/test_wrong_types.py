"""Arguments of a wrong type are refused with their name, their value and what was expected.

In a process of its own: the run-time type checks of this one would refuse them before the environment does.
"""

import json
import subprocess
import sys

import pytest

COUNT = "must be an integer of 1 or more, or None for no limit, got"
CASES = {
    "BinPickEnv(count='3')": "count must be an integer, got '3'",
    "BinPickEnv(count=None)": "count must be an integer, got None",
    "BinPickEnv(count=3.0)": "count must be an integer, got 3.0",
    "BinPickEnv(parts=None)": "parts must be a list of names or mesh files, got None; () takes the whole library",
    "BinPickEnv(scene_config={'count': 3})": "scene_config must be a SceneConfig or None, got {'count': 3}",
    "BinPickEnv(max_picks='2')": f"max_picks {COUNT} '2'",
    "BinPickEnv(max_picks=2.5)": f"max_picks {COUNT} 2.5",
    "BinPickEnv(max_picks=float('nan'))": f"max_picks {COUNT} nan",
    "BinPickEnv(max_picks=float('inf'))": f"max_picks {COUNT} inf",
    "BinPickEnv(max_consecutive_failures=None)": "max_consecutive_failures must be an integer of 1 or more, got None",
    "BinPickEnv(max_consecutive_failures='2')": "max_consecutive_failures must be an integer of 1 or more, got '2'",
    "BinPickVectorEnv('2')": "num_envs must be an integer of 1 or more, got '2'",
    "BinPickVectorEnv(1, max_concurrency=1.5)": f"max_concurrency {COUNT} 1.5",
    "BinServoEnv(max_ticks=float('nan'))": f"max_ticks {COUNT} nan",
    "BinServoEnv(images=None)": "images must be distinct names out of overhead, wrist, or (), got None",
    "BinServoEnv(images=[['wrist']])": "images must be distinct names out of overhead, wrist, or (), got [['wrist']]",
    "BinServoEnv(image_size='160x120')": "image_size must be (width, height) in pixels, got '160x120'",
    "BinServoEnv(image_size=(160, 120.0))": "height_px must be an integer, got 120.0",
    "BinServoEnv(count='3')": "count must be an integer, got '3'",
    "BinPickEnv(['hex_nut'], 1).reset(options='a.npz')": "options must be a dict or None, got 'a.npz'; valid keys: "
    "scene_file",
    "BinPickEnv(['hex_nut'], 1).reset(options={'scene_file': 3})": "options['scene_file'] must be a path, got 3",
}
CODE = """
import json, sys
from simpick.envs.bin_pick import BinPickEnv
from simpick.envs.bin_pick_vector import BinPickVectorEnv
from simpick.envs.bin_servo import BinServoEnv
from simpick.errors import ConfigError
found = []
for case in json.load(sys.stdin):
    try:
        eval(case)
        found.append("nothing was raised")
    except ConfigError as error:
        found.append(str(error))
    except Exception as error:
        found.append(repr(error))
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def messages() -> dict[str, str]:
    out = subprocess.run(
        [sys.executable, "-c", CODE], input=json.dumps(list(CASES)), capture_output=True, text=True, check=True
    )
    return dict(zip(CASES, json.loads(out.stdout), strict=True))


@pytest.mark.parametrize("case", CASES)
def test_the_argument_is_named(case: str, messages: dict[str, str]) -> None:
    assert messages[case] == CASES[case]
