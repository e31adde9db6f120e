import mujoco
import numpy as np
import pytest
import rerun as rr
import trimesh

from simpick.geometry.pinhole import opencv_from_mujoco_camera
from simpick.geometry.transforms import matrix_from_quaternion, transform
from simpick.recording import Instant, log_mujoco_model
from simpick.recording.geom_meshes import geom_mesh
from tests.recording.commands import is_whole
from tests.recording.reading import chunks, entities, series

ALL_GEOMS = """
<mujoco>
  <asset>
    <texture name="checks" type="2d" builtin="checker" rgb1="1 0 0" rgb2="0 0 1" width="64" height="64"/>
    <texture name="sky" type="cube" builtin="flat" rgb1="0 1 0" rgb2="0 1 0" width="8" height="8"/>
    <material name="checks" texture="checks" texrepeat="2 2"/>
    <material name="green" texture="sky"/>
    <material name="plain" rgba=".1 .2 .3 .5"/>
    <hfield name="hills" nrow="4" ncol="6" size=".3 .2 .1 .05"
      elevation="0 0 0 0 0 0  0 1 1 1 1 0  0 1 1 1 1 0  0 0 0 0 0 0"/>
    <mesh name="tetra" vertex="0 0 0  .1 0 0  0 .1 0  0 0 .1" texcoord="0 0  1 0  0 1  1 1"
      face="0 2 1  0 1 3  0 3 2  1 2 3"/>
  </asset>
  <worldbody>
    <geom name="plane" type="plane" size="1 2 .1" material="checks"/>
    <geom name="endless" type="plane" size="0 0 1" pos="0 0 -1"/>
    <geom name="hfield" type="hfield" hfield="hills"/>
    <body name="all" pos="0 0 1">
      <freejoint/>
      <geom name="sphere" size=".1"/>
      <geom name="capsule" type="capsule" size=".05 .2"/>
      <geom name="ellipsoid" type="ellipsoid" size=".1 .2 .3" material="plain"/>
      <geom name="cylinder" type="cylinder" size=".1 .2" material="plain" rgba="1 1 0 1"/>
      <geom name="box" type="box" size=".1 .2 .3" material="green"/>
      <geom name="mesh" type="mesh" mesh="tetra" material="checks"/>
      <geom name="bare" type="mesh" mesh="tetra"/>
      <geom name="hidden" type="box" size=".1 .1 .1" group="3"/>
      <geom name="invisible" type="box" size=".1 .1 .1" rgba="0 0 0 0"/>
    </body>
  </worldbody>
</mujoco>
"""
SOLIDS = ["sphere", "capsule", "ellipsoid", "cylinder", "box"]


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_string(ALL_GEOMS)


def mesh_of(model, name):
    mesh = geom_mesh(model, model.geom(name).id)
    assert mesh is not None
    return mesh


def record(path, model, data, then=None):
    stream = rr.RecordingStream("simpick", recording_id="test")
    stream.save(path)
    logger = log_mujoco_model(stream, model, data)
    if then is not None:
        then(logger)
    logger.flush()
    stream.disconnect()
    return logger


@pytest.mark.parametrize("name", [*SOLIDS, "mesh", "bare", "plane", "endless", "hfield"])
def test_every_geom_is_a_mesh_whose_normals_agree_with_its_winding(model, name):
    mesh = mesh_of(model, name)
    corners = mesh.vertices[mesh.faces]
    winding = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = mesh.normals[mesh.faces].mean(axis=1)
    assert np.all((winding * normals).sum(axis=1) > 0)
    assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)


@pytest.mark.parametrize("name", SOLIDS)
def test_solid_primitives_enclose_their_volume(model, name):
    mesh, size = mesh_of(model, name), model.geom(name).size
    volumes = {
        "sphere": 4 / 3 * np.pi * 0.1**3,
        "capsule": 4 / 3 * np.pi * 0.05**3 + np.pi * 0.05**2 * 0.4,
        "ellipsoid": 4 / 3 * np.pi * np.prod(size),
        "cylinder": np.pi * 0.1**2 * 0.4,
        "box": 8 * np.prod(size),
    }
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    volume = (a * np.cross(b, c)).sum() / 6
    assert volume == pytest.approx(volumes[name], rel=0.04)


def test_edges_of_meshes_stay_sharp_even_if_the_file_repeats_vertices():
    spec = mujoco.MjSpec()
    box = trimesh.creation.box((0.1, 0.2, 0.3))
    mesh = spec.add_mesh(name="box")
    mesh.uservert = box.triangles.astype(np.float32).ravel()
    mesh.userface = np.arange(36, dtype=np.int32)
    spec.worldbody.add_geom(name="box", type=mujoco.mjtGeom.mjGEOM_MESH, meshname="box")
    normals = mesh_of(spec.compile(), "box").normals
    # Eight corners with three normals each, all of them along an axis.
    assert len(normals) == 24
    assert np.allclose(np.abs(normals).max(axis=1), 1, atol=1e-4)


def test_plane_spans_its_size_and_an_endless_one_twice_the_models_extent(model):
    assert np.ptp(mesh_of(model, "plane").vertices, axis=0) == pytest.approx([2, 4, 0])
    assert mesh_of(model, "endless").vertices.max() == pytest.approx(2 * model.stat.extent)


def test_height_field_has_the_models_heights(model):
    heights = mesh_of(model, "hfield").vertices[:, 2].reshape(4, 6)
    assert heights[0, 0] == 0
    assert heights[1, 1] == pytest.approx(0.1)


def test_colours_follow_mujocos_rule(model):
    assert mesh_of(model, "ellipsoid").rgba == pytest.approx((0.1, 0.2, 0.3, 0.5))
    assert mesh_of(model, "cylinder").rgba == pytest.approx((1, 1, 0, 1))
    # A cube texture cannot be unwrapped: its mean colour stands for it.
    assert mesh_of(model, "box").rgba == pytest.approx((0, 1, 0, 1))


def test_textures_stay_on_planes_and_unwrapped_meshes(model):
    plane, mesh, bare = (mesh_of(model, name) for name in ("plane", "mesh", "bare"))
    assert plane.texture is not None
    assert mesh.texture is not None
    assert mesh.texcoords is not None
    assert mesh.texcoords.min() >= 0
    assert bare.texture is None
    # Two repeats of a checker of 2 x 2 fields: the colour changes every quarter.
    row = plane.texture[5, :, 0]
    assert np.count_nonzero(np.diff(row.astype(int))) == 3


def test_geometry_below_its_body_hidden_groups_left_out(model, tmp_path):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    path = tmp_path / "model.rrd"
    record(path, model, data)
    found = entities(path)
    assert {f"/world/all/{name}" for name in [*SOLIDS, "mesh"]} <= found
    assert {"/world/plane", "/world/hfield"} <= found
    assert not found & {"/world/all/hidden", "/world/all/invisible"}
    assert is_whole(path)


def test_names_with_slashes_become_one_part_and_clashes_are_resolved(tmp_path):
    model = mujoco.MjModel.from_xml_string("""
    <mujoco><worldbody>
      <geom name="crate" size=".1"/>
      <body name="arm"><geom size=".1"/></body>
      <body name="arm/link">
        <geom name="arm/link/shell" size=".1"/> <geom name="cam" size=".1"/> <camera name="cam"/>
      </body>
      <body name="crate"><geom size=".1"/></body>
      <body name="cameras"/>
      <body/>
    </worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    logger = record(tmp_path / "names.rrd", model, data)
    assert logger.body_paths[1:] == (
        "/world/arm",
        "/world/arm\\/link",
        "/world/crate",
        "/world/cameras_",
        "/world/body_5",
    )
    found = entities(tmp_path / "names.rrd")
    assert {"/world/arm\\/link/shell", "/world/arm\\/link/cam", "/world/cameras/cam", "/world/crate_"} <= found


def test_bodies_that_cannot_move_are_static_and_mocap_bodies_are_not(tmp_path):
    model = mujoco.MjModel.from_xml_string("""
    <mujoco><worldbody>
      <body name="post" pos="1 2 3"><geom size=".1"/></body>
      <body name="marker" mocap="true"><geom size=".1"/></body>
    </worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    path = tmp_path / "static.rrd"
    record(path, model, data)
    static = {
        c.entity_path: c.is_static
        for c in chunks(path)
        if "Transform3D:translation" in c.to_record_batch().schema.names
    }
    assert static["/world/post"]
    assert not static["/world/marker"]


def test_recorded_poses_are_the_models_in_opencv_axes_for_cameras(tmp_path):
    model = mujoco.MjModel.from_xml_string("""
    <mujoco><worldbody>
      <body name="a">
        <freejoint/> <geom type="box" size=".1 .2 .3"/> <camera name="eye" pos=".1 .2 .3" euler="30 40 50"/>
      </body>
    </worldbody></mujoco>""")
    data = mujoco.MjData(model)
    data.qvel[:] = [0.1, 0.2, 0.3, 1, 2, 3]
    mujoco.mj_forward(model, data)

    def follow(logger):
        for _ in range(100):
            mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        logger.tick(data, Instant(data.time))

    path = tmp_path / "poses.rrd"
    record(path, model, data, follow)
    expected = {
        "/world/a": transform(data.xmat[1].reshape(3, 3), data.xpos[1]),
        "/world/cameras/eye": opencv_from_mujoco_camera(transform(data.cam_xmat[0].reshape(3, 3), data.cam_xpos[0])),
    }
    for entity, T_world_frame in expected.items():
        times, positions = series(path, entity, "Transform3D:translation")
        _, quaternions = series(path, entity, "Transform3D:quaternion")
        assert times[-1] == pytest.approx(0.2)
        assert len(times) == 2
        assert np.allclose(positions[-1][0], T_world_frame[:3, 3], atol=1e-6)
        x, y, z, w = quaternions[-1][0]
        assert np.allclose(matrix_from_quaternion(np.array([w, x, y, z])), T_world_frame[:3, :3], atol=1e-6)
