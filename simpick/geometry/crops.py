"""Crops as virtual cameras: rotated so that the axis passes through a box's centre, zoomed so that the box fills it.

Such a crop is itself a pinhole image, not a cut-out: the homography ``K_crop R_crop_camera K^-1`` removes
perspective exactly, poses in the crop's frame become allocentric, and the source's intrinsics disappear. The camera's
centre does not move, so the frames differ by a rotation only: ``T_crop_part = T_crop_camera @ T_camera_part``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from simpick.errors import ConfigError
from simpick.geometry.pinhole import Pinhole
from simpick.geometry.transforms import skew, transform


@dataclass(frozen=True, eq=False)
class VirtualCameras:
    """Square virtual cameras that share the centre of a source camera; principal points in the middle."""

    size_px: int
    """Width and height of every crop."""
    focal_px: Float[np.ndarray, "n"]
    """Focal length of each camera, along both image axes."""
    Rs_crop_camera: Float[np.ndarray, "n 3 3"]
    """Map directions from the source camera's frame to each crop's frame."""

    def __len__(self) -> int:
        return len(self.focal_px)

    def rows(self, index: Int[np.ndarray, "m"]) -> VirtualCameras:
        """Return these cameras."""
        return VirtualCameras(self.size_px, self.focal_px[index], self.Rs_crop_camera[index])

    @property
    def Ks(self) -> Float[np.ndarray, "n 3 3"]:
        """Return the intrinsics of all cameras."""
        K = np.zeros((len(self), 3, 3))
        K[:, 0, 0] = K[:, 1, 1] = self.focal_px
        K[:, :2, 2] = self.size_px / 2
        K[:, 2, 2] = 1.0
        return K

    @property
    def Ts_crop_camera(self) -> Float[np.ndarray, "n 4 4"]:
        """Return the rotations as transforms."""
        return transform(self.Rs_crop_camera)

    def pinhole(self, index: int) -> Pinhole:
        """Return one virtual camera."""
        f = float(self.focal_px[index])
        return Pinhole(self.size_px, self.size_px, f, f, self.size_px / 2, self.size_px / 2)

    def homographies(self, camera: Pinhole) -> Float[np.ndarray, "n 3 3"]:
        """Return the homographies from source pixels to crop pixels, both with centres at integer + 0.5."""
        return self.Ks @ self.Rs_crop_camera @ np.linalg.inv(camera.K)


@dataclass(frozen=True, eq=False)
class CropBatch:
    """Crops of one source image with their cameras."""

    rgb: UInt8[np.ndarray, "n size size 3"]
    masks: Bool[np.ndarray, "n size size"] | None
    cameras: VirtualCameras

    def __len__(self) -> int:
        return len(self.rgb)


def aim_virtual_cameras(
    camera: Pinhole, boxes_xyxy_px: Float[np.ndarray, "n 4"], size_px: int, *, padding: float = 1.2
) -> VirtualCameras:
    """Return the virtual cameras whose axes pass through the boxes' centres, without roll.

    The focal length is the largest at which the whole padded square box (side = `padding` times the longer side of
    the box, about its centre) lies inside the crop: its outermost corner touches the crop's border.

    Raises:
        ConfigError: a box is not finite, has no area, lies entirely outside the image, or spans too wide an angle.
    """
    if size_px < 1 or not padding > 0:
        raise ConfigError(f"crop size and padding must be positive, got size_px={size_px}, padding={padding}")
    boxes = np.asarray(boxes_xyxy_px, float)
    _check_boxes(boxes, camera)
    centre = (boxes[:, :2] + boxes[:, 2:]) / 2
    half_side = padding * (boxes[:, 2:] - boxes[:, :2]).max(-1, initial=0.0) / 2

    axis = camera.back_project(centre, np.ones(len(boxes)))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    R_camera_crop = _shortest_rotation_from_z(axis)

    offsets = half_side[:, None, None] * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    corners = camera.back_project(centre[:, None] + offsets, np.ones((len(boxes), 4))) @ R_camera_crop
    if (corners[..., 2] <= 1e-3 * np.linalg.norm(corners, axis=-1)).any():
        raise ConfigError(f"padding {padding} makes a box wider than a camera can see (90 deg off its centre)")
    reach = np.abs(corners[..., :2] / corners[..., 2:]).max(axis=(1, 2), initial=0.0)
    return VirtualCameras(size_px, size_px / 2 / reach, np.swapaxes(R_camera_crop, -1, -2))


def crop_images(
    rgb: UInt8[np.ndarray, "height width 3"],
    camera: Pinhole,
    boxes_xyxy_px: Float[np.ndarray, "n 4"],
    size_px: int,
    *,
    masks: Sequence[Bool[np.ndarray, "height width"]] | None = None,
    padding: float = 1.2,
) -> CropBatch:
    """Return a virtual-camera crop of each box, black and unmasked where the source image ends.

    Where a crop has fewer pixels than its box, the image is averaged, not subsampled.

    Raises:
        ConfigError: as `aim_virtual_cameras`; image or masks differ in size from the camera, or there are not as many
            masks as boxes.
    """
    for name, image in [("image", rgb), *(("mask", m) for m in masks or [])]:
        if image.shape[:2] != (camera.height, camera.width):
            raise ConfigError(
                f"{name} must be {camera.width} x {camera.height} px like its camera, "
                f"got {image.shape[1]} x {image.shape[0]}; resize it or use `Pinhole.resized`"
            )
    if masks is not None and len(masks) != len(boxes_xyxy_px):
        raise ConfigError(f"there must be one mask for each box, got {len(masks)} for {len(boxes_xyxy_px)} boxes")
    cameras = aim_virtual_cameras(camera, boxes_xyxy_px, size_px, padding=padding)
    homographies = cameras.homographies(camera)
    out = np.zeros((len(cameras), size_px, size_px, 3), np.uint8)
    for i, H in enumerate(homographies):
        out[i] = warp(rgb, H, size_px)
    if masks is None:
        return CropBatch(out, None, cameras)
    warped = [warp(m.astype(np.uint8) * 255, H, size_px) > 127 for m, H in zip(masks, homographies, strict=True)]
    return CropBatch(out, np.array(warped, bool).reshape(-1, size_px, size_px), cameras)


def warp(
    image: UInt8[np.ndarray, "height width *channels"], homography: Float[np.ndarray, "3 3"], size_px: int
) -> UInt8[np.ndarray, "size size *channels"]:
    """Return the square image warped by `homography`; both images have pixel centres at integer + 0.5."""
    import cv2  # Imported here, so that geometry without images stays light.

    # Source pixels per crop pixel at the crop's centre: that many samples per side are averaged.
    centre = np.array([size_px / 2, size_px / 2, 1.0])
    samples = int(np.clip(np.ceil(_magnification(np.linalg.inv(homography), centre) - 0.25), 1, 16))
    # OpenCV puts pixel centres at integers.
    to_corners = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    H_cv = np.linalg.inv(to_corners) @ np.diag([samples, samples, 1.0]) @ homography @ to_corners
    shape = (size_px * samples, size_px * samples)
    warped = cv2.warpPerspective(image, H_cv, shape, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    if samples > 1:
        warped = cv2.resize(warped, (size_px, size_px), interpolation=cv2.INTER_AREA)
    return np.asarray(warped, np.uint8)


def _magnification(H: Float[np.ndarray, "3 3"], pixel: Float[np.ndarray, "3"]) -> float:
    """Return the local scale of a homography at a homogeneous pixel: the square root of its area magnification."""
    w = H[2] @ pixel
    jacobian = (H[:2, :2] - np.outer(H[:2] @ pixel / w, H[2, :2])) / w
    return float(np.sqrt(abs(np.linalg.det(jacobian))))


def _shortest_rotation_from_z(directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """Return the rotations without roll that map +z to these unit vectors, which point forward (z > 0)."""
    v = np.stack([-directions[:, 1], directions[:, 0], np.zeros(len(directions))], axis=-1)
    V = skew(v)
    return np.eye(3) + V + V @ V / (1 + directions[:, 2, None, None])


def _check_boxes(boxes: Float[np.ndarray, "n 4"], camera: Pinhole) -> None:
    """Raise `ConfigError` for the first box that cannot be cropped."""
    finite = np.isfinite(boxes).all(-1)
    degenerate = ~(boxes[:, 2:] > boxes[:, :2]).all(-1)
    outside = (boxes[:, :2] >= [camera.width, camera.height]).any(-1) | (boxes[:, 2:] <= 0).any(-1)
    for problem, text in [
        (~finite, "must be finite numbers"),
        (degenerate, "must have x1 < x2 and y1 < y2 (xyxy in pixels)"),
        (outside, f"must overlap the image of {camera.width} x {camera.height} px"),
    ]:
        if problem.any():
            i = int(np.argmax(problem))
            raise ConfigError(f"box {i} {text}, got {boxes[i].tolist()}; drop this detection or fix its box")
