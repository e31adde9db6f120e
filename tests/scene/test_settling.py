import hashlib
import subprocess
import sys

import numpy as np
import pytest

from simpick.assets.library import get_part
from simpick.errors import SceneError
from simpick.geometry.transforms import matrix_from_quaternion
from simpick.scene import BinConfig, ContactGroup, SceneConfig, build_scene
from simpick.scene.settling import MAX_PENETRATION_M, settle
from simpick.scene.sleep import wake_all

_OTHER_PROCESS = """
import hashlib
from simpick.scene import SceneConfig, build_scene
scene = build_scene(SceneConfig(parts=("hex_bolt", "pipe_tee", "l_bracket", "terminal_block"), count=8), seed=1)
scene.step(50)
print(hashlib.sha256(scene.data.qpos.tobytes()).hexdigest())
"""


def _digest(scene):
    scene.step(50)
    return hashlib.sha256(scene.data.qpos.tobytes()).hexdigest()


def test_the_same_seed_gives_the_same_bits_in_another_process(scene):
    run = subprocess.run([sys.executable, "-c", _OTHER_PROCESS], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == _digest(scene)


def test_seeds_differ_and_looks_do_not_change_the_physics(scene, config):
    other = build_scene(config, seed=2)
    assert not np.allclose(other.positions_m, scene.positions_m, atol=1e-3)
    plain = build_scene(SceneConfig(config.parts, config.count, randomization="none"), seed=1)
    np.testing.assert_array_equal(plain.positions_m, scene.positions_m)


@pytest.mark.parametrize(("count", "seed"), [(12, 0), (12, 3), (30, 0)])
def test_settled_parts_lie_in_the_bin_apart_and_still(count, seed):
    # Without sleeping, so that rest is real and not imposed.
    pool = ("hex_nut", "spur_gear", "crane_hook", "pillow_block", "keyed_shaft", "hinge_leaf")
    scene = build_scene(SceneConfig(pool, count, robot=None), seed)
    assert scene.parts_in_bin() == tuple(range(count))
    wake_all(scene.model, scene.data)
    assert scene.data.contact.dist.min() > -MAX_PENETRATION_M
    scene.model.opt.enableflags = 0
    before = scene.positions_m
    scene.step(500)
    drift = np.linalg.norm(scene.positions_m - before, axis=1)
    assert np.median(drift) < 2e-5
    assert drift.max() < 1e-3


def test_sleeping_parts_do_not_creep(scene):
    before = scene.positions_m
    scene.step(2500)
    assert np.linalg.norm(scene.positions_m - before, axis=1).max() < 1e-4


def test_instances_are_drawn_from_the_whole_pool(scene, config):
    assert {i.part.name for i in scene.instances} == set(config.parts)


def test_more_parts_than_the_bin_holds_are_refused_before_anything_is_simulated():
    config = SceneConfig(("pillow_block",), 50, robot=None, bin=BinConfig(0.12, 0.10, 0.08))
    text = r"50 parts \(pillow_block\) must fit into the bin .* litres\), got .* take at most \d+ parts or a larger"
    with pytest.raises(SceneError, match=text):
        build_scene(config, seed=0)


def test_parts_that_do_not_stay_in_the_bin_end_in_an_error_that_says_what_to_do():
    config = SceneConfig(("pillow_block",), 12, robot=None, bin=BinConfig(0.10, 0.08, 0.06))
    with pytest.raises(
        SceneError, match=r"of 12 parts \(pillow_block\) did not come to rest in the bin, .* take fewer"
    ):
        build_scene(config, seed=0)


def test_parts_that_fall_beside_the_bin_are_counted_and_dropped_again():
    config = SceneConfig(("pillow_block",), 6, robot=None, bin=BinConfig(0.08, 0.06, 0.05))
    scene = build_scene(config, seed=0)
    assert scene.redropped > 0
    assert scene.parts_in_bin() == tuple(range(6))


def test_sleeping_does_not_hide_a_blow(scene):
    """A part that falls on sleeping ones wakes them."""
    scene.step(100)
    trees = [scene.model.body_treeid[i.body_id] for i in scene.instances]
    assert not scene.data.tree_awake[trees].any()
    T_world_part = scene.T_world_part(1)
    T_world_part[2, 3] += 0.10
    scene.place({0: T_world_part})
    scene.step(20)
    assert not scene.data.tree_awake[trees[1]]
    for _ in range(100):
        scene.step()
        if scene.data.tree_awake[trees[1]]:
            break
    assert scene.data.tree_awake[trees[1]]
    assert scene.touching(ContactGroup.PART, ContactGroup.PART)


@pytest.mark.parametrize(("name", "seed"), [("l_bracket", 2), ("pipe_tee", 3)])
def test_aligned_parts_come_to_rest_parallel_to_one_another(name, seed):
    config = SceneConfig(parts=(name,), count=12)
    parts = [get_part(name)] * 12

    def parallelism(aligned):
        qpos = settle(config, parts, np.random.default_rng(seed), aligned=aligned).qpos
        vertical = matrix_from_quaternion(qpos[:, 3:])[:, 2]
        return np.median(np.abs(vertical @ vertical.T)[np.triu_indices(12, 1)])

    assert parallelism(True) > 0.95 and parallelism(True) > parallelism(False) + 0.2
