"""Shows any MuJoCo model in rerun: geometry once, then one transform for each body that moved."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
import rerun as rr
from jaxtyping import Bool, Float

from simpick.geometry.pinhole import Pinhole, opencv_from_mujoco_camera
from simpick.geometry.transforms import quaternion_from_matrix, transform
from simpick.recording.column_buffer import ColumnBuffer, Instant
from simpick.recording.entity_names import EntityNames
from simpick.recording.geom_meshes import GeomMesh, geom_mesh
from simpick.recording.object_names import object_name
from simpick.recording.pinhole_archetype import pinhole_archetype

DEFAULT_GROUPS = (0, 1, 2)
"""Geom groups that MuJoCo's own viewer shows at start; collision geoms are in group 3 by convention."""
_MOVED_M = 2e-5
_MOVED_QUATERNION = 5e-5
"""Least change of a quaternion's component that counts as motion: about 0.006 degrees."""


class MujocoLogger:
    """Logs one `MjModel` below ``/<root>`` of a recording.

    Each body is one entity ``/<root>/<body>`` in world coordinates (no nesting), its geoms lie below it; geoms of the
    world body lie directly below the root, cameras under ``/<root>/cameras``. Slashes in names are escaped. Bodies
    that cannot move are static. Sites, tendons, skins and flexes are not drawn.
    """

    def __init__(
        self,
        stream: rr.RecordingStream,
        model: mujoco.MjModel,
        *,
        root: str = "world",
        groups: Sequence[int] = DEFAULT_GROUPS,
    ) -> None:
        root = f"/{root.strip('/')}"
        self._stream, self._model, self._root, self._groups = stream, model, root, frozenset(groups)
        self._names = EntityNames()
        # Reserved before any body may claim them.
        cameras_path = self._names.path(root, "cameras")
        self.detections_path: str = self._names.path(root, "detections")
        self.estimates_path: str = self._names.path(root, "estimates")
        self.truth_path: str = self._names.path(root, "truth")
        self.grasp_path: str = self._names.path(root, "grasp")
        bodies = [root] + [
            self._names.path(root, object_name(model, mujoco.mjtObj.mjOBJ_BODY, body)) for body in range(1, model.nbody)
        ]
        self.body_paths: tuple[str, ...] = tuple(bodies)
        """Entity of each body, by body id; the world body's is the root."""
        names = [object_name(model, mujoco.mjtObj.mjOBJ_CAMERA, camera) for camera in range(model.ncam)]
        self.camera_paths: dict[str, str] = {name: self._names.path(cameras_path, name) for name in names}
        """Entity of each camera, by name."""
        self.buffer = ColumnBuffer(stream, [*bodies, *self.camera_paths.values()])
        """Rows that `flush` will send; scalars of other entities may join them."""
        mobile = _mobile_bodies(model)
        # Cameras may be moved by their mode or by a caller, so none of them is taken for static.
        self._mobile = np.concatenate([mobile, np.ones(model.ncam, bool)])
        self.moving_cameras: frozenset[str] = frozenset(
            name for name, body in zip(names, model.cam_bodyid, strict=True) if mobile[body]
        )
        """Names of the cameras that ride on a body that can move."""
        self._last = np.full((model.nbody + model.ncam, 7), np.nan)

    def log_static(self, data: mujoco.MjData) -> None:
        """Log all that never changes: axes, geometry, and the places of immobile bodies."""
        self._log(self._root, rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        poses = self._poses(data)
        for body in np.flatnonzero(~self._mobile[: self._model.nbody]):
            if body > 0:
                self._log(self.body_paths[body], _transform3d(poses[body]))
        for geom in range(self._model.ngeom):
            self._log_geom(geom)
        for camera, path in enumerate(self.camera_paths.values()):
            self._log(path, pinhole_archetype(camera_pinhole(self._model, camera)))

    def tick(self, data: mujoco.MjData, instant: Instant) -> None:
        """Note the bodies and cameras that moved since the last tick; `flush` sends them."""
        poses = self._poses(data)
        change = np.abs(poses - self._last)
        # A frame never noted before compares as not-a-number, which counts as moved.
        still = (change[:, :3].max(axis=1) < _MOVED_M) & (change[:, 3:].max(axis=1) < _MOVED_QUATERNION)
        moved = np.flatnonzero(~still & self._mobile)
        if len(moved):
            self._last[moved] = poses[moved]
            self.buffer.add_transforms(instant, moved, poses[moved])

    def flush(self) -> None:
        """Send what `tick` noted."""
        self.buffer.flush()

    def log_camera(
        self, name: str, camera: Pinhole, T_world_camera: Float[np.ndarray, "4 4"], instant: Instant
    ) -> None:
        """Note the pose with which an image was taken, and its intrinsics (which hold for the whole recording)."""
        index = list(self.camera_paths).index(name)
        pose = _pose(T_world_camera)
        self._last[self._model.nbody + index] = pose
        self.buffer.add_transforms(instant, np.array([self._model.nbody + index]), pose[None])
        self._log(self.camera_paths[name], pinhole_archetype(camera))

    def _poses(self, data: mujoco.MjData) -> Float[np.ndarray, "frames 7"]:
        bodies = np.concatenate([data.xpos, data.xquat], axis=1)
        if not self._model.ncam:
            return bodies
        T_world_mjcamera = transform(data.cam_xmat.reshape(-1, 3, 3), data.cam_xpos)
        return np.concatenate([bodies, _pose(opencv_from_mujoco_camera(T_world_mjcamera))])

    def _log_geom(self, geom: int) -> None:
        model = self._model
        if int(model.geom_group[geom]) not in self._groups:
            return
        mesh = geom_mesh(model, geom)
        if mesh is None or mesh.rgba[3] == 0:
            return
        body = int(model.geom_bodyid[geom])
        name = object_name(model, mujoco.mjtObj.mjOBJ_GEOM, geom)
        # Inside body "part_00" a geom called "part_00/visual" is simply "visual".
        name = name.removeprefix(f"{object_name(model, mujoco.mjtObj.mjOBJ_BODY, body)}/") or name
        path = self._names.path(self.body_paths[body], name)
        placement = np.concatenate([model.geom_pos[geom], model.geom_quat[geom]])
        self._log(path, _transform3d(placement), mesh_archetype(mesh))

    def _log(self, path: str, *archetypes: rr.AsComponents) -> None:
        self._stream.log(path, *archetypes, static=True, strict=True)


def log_mujoco_model(
    stream: rr.RecordingStream,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    *,
    root: str = "world",
    groups: Sequence[int] = DEFAULT_GROUPS,
) -> MujocoLogger:
    """Log a model's geometry and present state, and return the logger that follows its motion.

    ``data`` must have its kinematics up to date (`mujoco.mj_forward`). Go on with ``logger.tick(data, Instant(...))``
    as often as needed and ``logger.flush()`` from time to time, at the latest before the recording is closed.
    """
    logger = MujocoLogger(stream, model, root=root, groups=groups)
    logger.log_static(data)
    logger.tick(data, Instant(float(data.time)))
    logger.flush()
    return logger


def mesh_archetype(mesh: GeomMesh) -> rr.Mesh3D:
    """Return the mesh as rerun draws it."""
    return rr.Mesh3D(
        vertex_positions=mesh.vertices.astype(np.float32),
        vertex_normals=mesh.normals.astype(np.float32),
        triangle_indices=mesh.faces.astype(np.uint32),
        vertex_texcoords=None if mesh.texcoords is None else mesh.texcoords.astype(np.float32),
        albedo_texture=mesh.texture,
        albedo_factor=[round(255 * value) for value in mesh.rgba],
    )


def camera_pinhole(model: mujoco.MjModel, camera: int, fallback_px: tuple[int, int] = (640, 480)) -> Pinhole:
    """Return a model camera's intrinsics; `fallback_px` (width, height) where the model gives no resolution."""
    width, height = (int(value) for value in model.cam_resolution[camera])
    if width <= 1 or height <= 1:
        width, height = fallback_px
    return Pinhole.from_fovy(width, height, float(model.cam_fovy[camera]))


def _mobile_bodies(model: mujoco.MjModel) -> Bool[np.ndarray, "bodies"]:
    mobile = np.zeros(model.nbody, bool)
    for body in range(1, model.nbody):
        own = model.body_jntnum[body] > 0 or model.body_mocapid[body] >= 0
        mobile[body] = own or mobile[model.body_parentid[body]]
    return mobile


def _pose(T_world_frame: Float[np.ndarray, "*batch 4 4"]) -> Float[np.ndarray, "*batch 7"]:
    quaternion = quaternion_from_matrix(T_world_frame[..., :3, :3])
    return np.concatenate([T_world_frame[..., :3, 3], quaternion], axis=-1)


def _transform3d(pose: Float[np.ndarray, "7"]) -> rr.Transform3D:
    return rr.Transform3D(translation=pose[:3], quaternion=rr.Quaternion(xyzw=pose[[4, 5, 6, 3]]))
