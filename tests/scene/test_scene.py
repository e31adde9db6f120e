import json
from dataclasses import replace

import numpy as np
import pytest

from simpick.caching import read_arrays, write_arrays
from simpick.errors import OutputError, SceneError, SimulationFaultError, UnknownNameError
from simpick.geometry.transforms import transform
from simpick.scene import ContactGroup, Scene, SceneConfig, build_scene
from simpick.scene.archive import read_archive, write_archive
from simpick.scene.workspace import CHUTE_CENTRE_M, bin_interior


def test_truth_holds_poses_and_parts_of_all_instances(scene, config):
    truth = scene.truth()
    assert [t.instance for t in truth] == list(range(config.count))
    assert all(t.in_bin for t in truth)
    for reported, instance in zip(truth, scene.instances, strict=True):
        assert reported.part == instance.part.name
        np.testing.assert_allclose(reported.T_world_part[:3, 3], scene.positions_m[reported.instance], atol=1e-12)


def test_every_geom_of_a_part_leads_to_its_instance_and_no_other_does(scene):
    for geom in range(scene.model.ngeom):
        name = scene.model.body(scene.model.geom_bodyid[geom]).name
        expected = int(name.removeprefix("part_")) if name.startswith("part_") else -1
        assert scene.instance_of_geom[geom] == expected
        assert (scene.group_of_geom[geom] == ContactGroup.PART) == (expected >= 0)


def test_the_overhead_camera_sees_the_whole_bin_with_world_x_up(scene):
    camera, T_world_camera = scene.camera("overhead")
    box = bin_interior(scene.config.bin)
    corners = np.array([[x, y, z] for x in (0.35, 0.65) for y in (-0.2, 0.2) for z in (0.0, 0.12)])
    assert np.all(box.contains(corners))
    points = (corners - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
    pixels = camera.project(points)
    assert np.all(pixels > 10) and np.all(pixels < [camera.width - 10, camera.height - 10])
    near, far = pixels[np.isclose(corners[:, 0], 0.35)], pixels[np.isclose(corners[:, 0], 0.65)]
    assert far[:, 1].max() < near[:, 1].min()
    right, left = pixels[corners[:, 1] < 0], pixels[corners[:, 1] > 0]
    assert left[:, 0].max() < right[:, 0].min()


def test_the_wrist_camera_looks_at_the_tcp(scene):
    camera, T_world_camera = scene.camera("wrist")
    tcp = scene.data.site("gripper/tcp").xpos
    x, y = camera.project((tcp - T_world_camera[:3, 3]) @ T_world_camera[:3, :3])
    assert abs(x - camera.width / 2) < 1
    assert camera.height / 2 < y < camera.height


def test_an_unknown_camera_lists_those_that_exist(scene):
    with pytest.raises(UnknownNameError, match=r"no camera named 'left'. Valid: overhead, overview, wrist\."):
        scene.camera("left")


def test_a_scene_without_robot_has_no_wrist_camera():
    scene = build_scene(SceneConfig(("hex_nut",), 1, robot=None), seed=0)
    assert scene.cameras == ("overhead", "overview")
    assert scene.robot is None and scene.gripper is None


def test_delivered_and_lost_parts_are_known_by_their_position(scene):
    scene.place({0: transform(translation=np.array(CHUTE_CENTRE_M) + np.array([0, 0, 0.05]))})
    scene.place({1: transform(translation=np.array([0.9, 0.5, 0.1]))})
    assert scene.in_chute(0) and not scene.in_bin(0)
    assert scene.parts_elsewhere() == (1,)
    assert scene.parts_in_bin() == tuple(range(2, 8))
    scene.step(300)
    assert scene.in_chute(0)
    assert scene.parts_elsewhere() == (1,)


def test_removed_parts_are_gone_for_good_and_disturb_nothing(scene):
    before = scene.positions_m
    scene.remove(3)
    scene.remove(3)
    scene.step(500)
    assert scene.removed == (3,)
    assert 3 not in [t.instance for t in scene.truth()] and 3 not in scene.parts_in_bin()
    assert np.linalg.norm(scene.positions_m[3]) > 20
    assert scene.parts_elsewhere() == ()
    assert not scene.data.tree_awake[scene.model.body_treeid[scene.instances[3].body_id]]
    others = [i for i in range(8) if i != 3]
    np.testing.assert_allclose(scene.positions_m[others], before[others], atol=5e-3)
    with pytest.raises(SceneError, match="instance must be between 0 and 7, got 8"):
        scene.remove(8)


def test_the_arm_holds_its_home_pose(scene):
    before = scene.data.site("gripper/tcp").xpos.copy()
    scene.step(500)
    assert np.linalg.norm(scene.data.site("gripper/tcp").xpos - before) < 1e-3


def test_a_pinched_part_is_felt_held_and_does_not_creep(scene):
    block = next(i for i in scene.instances if i.part.name == "terminal_block")
    tcp = scene.data.site("gripper/tcp")
    T_world_tcp = transform(tcp.xmat.reshape(3, 3), tcp.xpos)
    width = float(block.part.extents_m[0])
    scene.gripper.reset(scene.model, scene.data, width + 0.002)
    scene.place({block.instance: T_world_tcp})
    scene.gripper.grip(scene.model, scene.data)
    scene.step(250)
    assert scene.gripper.held_bodies(scene.model, scene.data) == (block.body_id,)
    assert 10 < scene.contact_force_n(ContactGroup.GRIPPER, ContactGroup.PART) < 100
    assert not scene.touching(ContactGroup.GRIPPER, ContactGroup.BIN)
    held = scene.positions_m[block.instance]
    scene.step(1000)
    assert np.linalg.norm(scene.positions_m[block.instance] - held) < 1e-4


@pytest.mark.parametrize("value", [np.nan, 1e6])
def test_a_diverged_scene_says_so(scene, value):
    scene.data.qvel[-1] = value
    with pytest.raises(SimulationFaultError, match=r"the physics diverged at .* the scene cannot be used further"):
        scene.step()


def test_a_part_may_spin_as_fast_as_the_jaw_throws_it_but_not_faster(scene):
    spin = scene.instances[0].dof_adr + 5
    scene.data.qvel[spin] = 400.0
    scene.check_finite()
    scene.data.qvel[spin] = 4000.0
    with pytest.raises(SimulationFaultError, match="largest joint speed 4e"):
        scene.check_finite()


def test_a_saved_scene_continues_bit_for_bit(scene, tmp_path):
    scene.remove(2)
    T_world_part = scene.T_world_part(1)
    T_world_part[2, 3] += 0.15
    scene.place({0: T_world_part})
    scene.data.ctrl[0] += 0.2
    scene.step(60)
    again = Scene.load(scene.save(tmp_path / "scene.npz"))
    assert again.config == scene.config and again.removed == (2,)
    np.testing.assert_array_equal(again.truth()[1].T_world_part, scene.truth()[1].T_world_part)
    for one in (scene, again):
        one.step(200)
    np.testing.assert_array_equal(again.data.qpos, scene.data.qpos)
    np.testing.assert_array_equal(again.data.qvel, scene.data.qvel)


def test_a_saved_vacuum_still_holds(tmp_path):
    scene = build_scene(SceneConfig(parts=("terminal_block",), count=1, gripper="suction"), seed=0)
    gripper = scene.gripper
    assert gripper is not None
    face = scene.data.site(gripper.tcp_site).xpos
    half_height = scene.instances[0].part.extents_m[2] / 2
    scene.place({0: transform(translation=face - [0, 0, half_height + 0.0005])})
    for one in (scene, Scene.load(scene.save(tmp_path / "before.npz"))):
        assert gripper.held_bodies(one.model, one.data) == ()
    gripper.grip(scene.model, scene.data)
    scene.step(100)
    again = Scene.load(scene.save(tmp_path / "held.npz"))
    for one in (scene, again):
        one.step(100)
        assert gripper.held_bodies(one.model, one.data) == (one.instances[0].body_id,)
    np.testing.assert_array_equal(again.data.qpos, scene.data.qpos)


def test_files_that_are_no_scene_are_refused(scene, tmp_path):
    with pytest.raises(SceneError, match="no scene file at"):
        Scene.load(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(SceneError, match="is not a scene file that simpick wrote"):
        Scene.load(tmp_path / "text.npz")
    with pytest.raises(OutputError, match=r"cannot write the scene to .*; choose a writable folder"):
        scene.save(tmp_path / "missing" / "scene.npz")


def test_a_scene_of_another_mujoco_is_noticed(scene, tmp_path):
    path = scene.save(tmp_path / "scene.npz")
    write_archive(path, replace(read_archive(path), mujoco_version="1.50"))
    with pytest.raises(SceneError, match=r"scene.npz must be of MuJoCo \d.*, got 1\.50"):
        Scene.load(path)


def test_a_saved_name_that_does_not_exist_is_an_error_of_the_file(scene, tmp_path):
    path = scene.save(tmp_path / "scene.npz")
    arrays = read_arrays(path)
    header = json.loads(str(arrays["header"]))
    header["config"]["randomization"] = "dark"
    write_arrays(path, arrays | {"header": np.array(json.dumps(header))})
    with pytest.raises(SceneError, match=r"scene.npz is not a scene file .* no randomization preset named 'dark'"):
        Scene.load(path)


def test_a_part_that_has_changed_since_saving_is_noticed(scene, tmp_path):
    path = scene.save(tmp_path / "scene.npz")
    archive = read_archive(path)
    write_archive(path, replace(archive, part_hashes=("0" * 16, *archive.part_hashes[1:])))
    with pytest.raises(SceneError, match=r"must have the content hash 0{16} of the scene in"):
        Scene.load(path)


@pytest.fixture(scope="module")
def saved(config, tmp_path_factory):
    return build_scene(config, seed=1).save(tmp_path_factory.mktemp("scenes") / "scene.npz")


def rewritten(saved, path, change):
    """Write a scene file again with some of its arrays, and values of its header, changed."""
    arrays = read_arrays(saved)
    header = json.loads(str(arrays["header"]))
    change(arrays, header)
    write_arrays(path, arrays | {"header": np.array(json.dumps(header))})
    return path


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda a, h: a.update(state=a["state"][:1]), "does not fit the scene that it describes: state must have"),
        (lambda a, h: a.update(adhesion_n=a["adhesion_n"][:1]), "describes: adhesion_n must have the model's length"),
        (lambda a, h: a.update({"sleep/qacc": a["sleep/qacc"][:1]}), "describes: qacc must have"),
        (
            lambda a, h: a.update({"sleep/body_awake_ind": a["sleep/body_awake_ind"] + 10**6}),
            "body_awake_ind must have",
        ),
        (lambda a, h: a.pop("sleep/tree_awake"), "describes: tree_awake must have"),
        (lambda a, h: a.update(state=a["state"].astype(complex)), "state must hold finite numbers in double precision"),
        (lambda a, h: a.update(state=a["state"] * np.nan), "state must hold finite numbers"),
        (lambda a, h: h.update(seed=-1), r"seed must be at least 0, got -1"),
        (lambda a, h: h.update(seed=10**400), r"seed must be an integer, got an integer of 1329 bits"),
        (lambda a, h: h.update(removed=[0, 99]), "removed must hold different instances below"),
        (lambda a, h: h.update(removed=None), "removed must be a tuple"),
        (
            lambda a, h: h.update(part_hashes=h["part_hashes"][1:]),
            "must hold 8 parts, as its configuration says, has 7",
        ),
        (lambda a, h: h.pop("mujoco"), "mujoco is missing"),
        (lambda a, h: h.pop("format"), "its header states no format"),
    ],
)
def test_numbers_that_do_not_fit_are_refused(change, expected, saved, tmp_path):
    with pytest.raises(SceneError, match=expected):
        Scene.load(rewritten(saved, tmp_path / "scene.npz", change))
