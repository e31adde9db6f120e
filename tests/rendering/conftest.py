"""Small worlds to be rendered, without the library of parts."""

import mujoco
import numpy as np
import pytest
import trimesh

from simpick.assets.part import Material, Part
from simpick.geometry import Pinhole, look_at, opencv_from_mujoco_camera, quaternion_from_matrix

CAMERA = Pinhole.from_fovy(96, 80, 40.0)


@pytest.fixture(scope="session")
def wedge() -> Part:
    """A part without any symmetry."""
    a = trimesh.creation.box((0.06, 0.03, 0.02))
    b = trimesh.creation.box((0.02, 0.02, 0.03), transform=trimesh.transformations.translation_matrix((0.02, 0, 0.02)))
    mesh = trimesh.boolean.union([a, b], engine="manifold")
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    return Part("wedge", mesh, (mesh.convex_hull,), material=Material(rgb=(0.2, 0.05, 0.02)))


class BoxScene:
    """Two boxes under a camera: instance 1 half a box width aside and above instance 0. Looks like a scene."""

    def __init__(self) -> None:
        T = opencv_from_mujoco_camera(look_at(np.array([0.0, 0.0, 1.0]), np.zeros(3)))
        spec = mujoco.MjSpec()
        spec.stat.extent, spec.visual.map.znear, spec.visual.map.zfar = 1.0, 0.02, 10.0
        spec.worldbody.add_camera(
            name="overhead", pos=T[:3, 3], quat=quaternion_from_matrix(T[:3, :3]), fovy=CAMERA.fovy_deg
        )
        spec.worldbody.add_light(pos=[0, 0, 2], dir=[0, 0, -1])
        box = mujoco.mjtGeom.mjGEOM_BOX
        floor = spec.worldbody.add_geom(name="floor", type=box, size=[2, 2, 0.01], pos=[0, 0, -0.5])
        floor.rgba = [0.3, 0.3, 0.3, 1.0]
        for k, (pos, rgba) in enumerate((([0, 0, 0], [1, 0, 0, 1]), ([0.05, 0, 0.05], [0, 1, 0, 1]))):
            body = spec.worldbody.add_body(name=f"part_{k:02d}", pos=pos)
            body.add_geom(name=f"visual_{k}", type=box, size=[0.05, 0.05, 0.001], rgba=rgba, group=2)
            body.add_geom(name=f"collision_{k}", type=box, size=[0.2, 0.2, 0.2], rgba=[0, 0, 1, 1], group=3)
            body.add_site(name=f"site_{k}", size=[0.3, 0.3, 0.3], rgba=[0, 0, 1, 1])
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.instance_of_geom = np.full(self.model.ngeom, -1, np.int32)
        for k in range(2):
            self.instance_of_geom[self.model.geom_bodyid == self.model.body(f"part_{k:02d}").id] = k
        self.T_world_camera = opencv_from_mujoco_camera(T)
        self.cameras = ("overhead",)
        mujoco.mj_forward(self.model, self.data)

    def camera(self, name: str):
        return CAMERA, self.T_world_camera


@pytest.fixture
def boxes() -> BoxScene:
    return BoxScene()
