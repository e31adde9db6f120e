"""The scene's cameras: where they stand, and their intrinsics and poses while the scene moves."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float

from simpick.assets.mjcf import VISUAL_GROUP
from simpick.errors import UnknownNameError
from simpick.geometry.pinhole import Pinhole, opencv_from_mujoco_camera
from simpick.geometry.transforms import look_at, quaternion_from_matrix, transform
from simpick.scene.config import CameraConfig, SceneConfig
from simpick.scene.workspace import BIN_CENTRE_M

OVERHEAD, WRIST, OVERVIEW = "overhead", "wrist", "overview"
"""Names of the cameras: above the bin (image up is world +x, image right is world -y), on the hand, for display."""

_OVERVIEW_EYE_M = np.array([1.45, -1.05, 0.95])
_OVERVIEW_TARGET_M = np.array([0.30, -0.12, 0.17])
# Beside the palm, off the fingers' closing axis (x), tilted so that its axis meets theirs about 5 cm beyond the TCP.
_WRIST_EYE_M = np.array([0.0, -0.070, 0.045])
_WRIST_TARGET_M = np.array([0.0, 0.0, 0.26])


def overhead_pose(config: SceneConfig) -> Float[np.ndarray, "4 4"]:
    """Return the nominal T_world_camera of the overhead camera (OpenCV axes)."""
    eye = np.array(BIN_CENTRE_M) + np.array([0.0, 0.0, config.overhead_height_m])
    return look_at(eye, np.array(BIN_CENTRE_M))


def add_fixed_cameras(spec: mujoco.MjSpec, config: SceneConfig, T_camera_jittered: Float[np.ndarray, "4 4"]) -> None:
    """Add the overhead camera, displaced by its jitter, and the overview camera."""
    _add(spec.worldbody, OVERHEAD, overhead_pose(config) @ T_camera_jittered, config.overhead)
    _add(spec.worldbody, OVERVIEW, look_at(_OVERVIEW_EYE_M, _OVERVIEW_TARGET_M), config.overview)


def add_wrist_camera(body: mujoco.MjsBody, T_body_flange: Float[np.ndarray, "4 4"], config: CameraConfig) -> None:
    """Add the wrist camera to the arm's last body; the flange's +z points away from the arm."""
    T_flange_camera = look_at(_WRIST_EYE_M, _WRIST_TARGET_M, up=np.array([0.0, -1.0, 0.0]))
    T_body_camera = T_body_flange @ T_flange_camera
    _add(body, WRIST, T_body_camera, config)
    # Housing and bracket, for display only: they end just behind the lens and touch nothing.
    T_body_housing = T_body_camera @ transform(translation=np.array([0.0, 0.0, -0.022]))
    _add_look(body, "wrist_camera/housing", T_body_housing, (0.022, 0.016, 0.018))
    T_body_bracket = T_body_flange @ transform(translation=np.array([0.0, -0.045, 0.012]))
    _add_look(body, "wrist_camera/bracket", T_body_bracket, (0.012, 0.035, 0.004))


def _add_look(
    body: mujoco.MjsBody, name: str, T_body_box: Float[np.ndarray, "4 4"], half_sides_m: tuple[float, float, float]
) -> None:
    body.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=half_sides_m, rgba=[0.12, 0.12, 0.13, 1.0],
        pos=T_body_box[:3, 3], quat=quaternion_from_matrix(T_body_box[:3, :3]),
        group=VISUAL_GROUP, contype=0, conaffinity=0, mass=0.0,
    )  # fmt: skip


def _add(body: mujoco.MjsBody, name: str, T_body_camera: Float[np.ndarray, "4 4"], config: CameraConfig) -> None:
    T_body_mjcamera = opencv_from_mujoco_camera(T_body_camera)
    camera = body.add_camera(name=name, fovy=config.fovy_deg)
    camera.resolution = [config.width_px, config.height_px]
    camera.pos = T_body_mjcamera[:3, 3]
    camera.quat = quaternion_from_matrix(T_body_mjcamera[:3, :3])


def camera_pinhole(model: mujoco.MjModel, name: str) -> Pinhole:
    """Return the intrinsics of a camera of `model`; raises UnknownNameError."""
    k = camera_id(model, name)
    width, height = model.cam_resolution[k]
    return Pinhole.from_fovy(int(width), int(height), float(model.cam_fovy[k]))


def camera_pose(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> Float[np.ndarray, "4 4"]:
    """Return T_world_camera (OpenCV axes) as of the last kinematics; raises UnknownNameError."""
    k = camera_id(model, name)
    return opencv_from_mujoco_camera(transform(data.cam_xmat[k].reshape(3, 3), data.cam_xpos[k]))


def camera_id(model: mujoco.MjModel, name: str) -> int:
    """Return MuJoCo's index of a camera; raises UnknownNameError with those that exist."""
    k = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name)
    if k < 0:
        raise UnknownNameError("camera", name, [model.camera(i).name for i in range(model.ncam)])
    return k
