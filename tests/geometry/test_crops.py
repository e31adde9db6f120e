"""Virtual-camera crops: where points land, what the pixels show, and which boxes are refused."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simpick.errors import ConfigError
from simpick.geometry import CropBatch, Pinhole, aim_virtual_cameras, crop_images

CAMERA = Pinhole(640, 480, 600.0, 580.0, 310.0, 250.0)


@st.composite
def boxes(draw: st.DrawFn) -> np.ndarray:
    x, y = draw(st.floats(0, 600)), draw(st.floats(0, 440))
    return np.array([x, y, x + draw(st.floats(2, 300)), y + draw(st.floats(2, 300))])


def apply(H: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    mapped = np.concatenate([pixels, np.ones_like(pixels[..., :1])], -1) @ H.T
    return mapped[..., :2] / mapped[..., 2:]


def smooth_scene(camera: Pinhole, R_world_camera: np.ndarray) -> np.ndarray:
    """Return an image of a smooth pattern painted on the sky: colour depends on the world direction alone."""
    rays = camera.rays()
    directions = rays / np.linalg.norm(rays, axis=-1, keepdims=True) @ R_world_camera.T
    return (127.5 + 120 * np.sin(directions * [25, 31, 37])).astype(np.uint8)


@given(boxes(), st.floats(1, 2))
def test_points_land_where_the_virtual_camera_projects_them(box: np.ndarray, padding: float) -> None:
    cameras = aim_virtual_cameras(CAMERA, box[None], 128, padding=padding)
    rng = np.random.default_rng(0)
    points_camera = CAMERA.back_project(rng.uniform(box[:2], box[2:], (50, 2)), rng.uniform(0.3, 2, 50))
    expected = cameras.pinhole(0).project(points_camera @ cameras.Rs_crop_camera[0].T)
    landed = apply(cameras.homographies(CAMERA)[0], CAMERA.project(points_camera))
    np.testing.assert_allclose(landed, expected, atol=1e-6)


@given(boxes(), st.floats(1, 2))
def test_padded_square_fills_the_crop_to_its_outermost_corner(box: np.ndarray, padding: float) -> None:
    cameras = aim_virtual_cameras(CAMERA, box[None], 100, padding=padding)
    centre, half = (box[:2] + box[2:]) / 2, padding * (box[2:] - box[:2]).max() / 2
    corners = centre + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    landed = apply(cameras.homographies(CAMERA)[0], corners)
    assert np.abs(landed - 50).max() == pytest.approx(50)
    np.testing.assert_allclose(apply(cameras.homographies(CAMERA)[0], centre[None]), [[50, 50]], atol=1e-9)


@given(boxes())
def test_virtual_camera_does_not_roll(box: np.ndarray) -> None:
    R = aim_virtual_cameras(CAMERA, box[None], 64).Rs_crop_camera[0]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    # The shortest rotation has its axis in the image plane.
    assert R[0, 1] == pytest.approx(R[1, 0], abs=1e-12)


def crop_one(rgb, camera: Pinhole, box, size_px: int, mask=None, padding: float = 1.2) -> CropBatch:
    masks = None if mask is None else [mask]
    return crop_images(rgb, camera, np.array([box]), size_px, masks=masks, padding=padding)


def test_crop_shows_what_the_virtual_camera_would_have_seen() -> None:
    crop = crop_one(smooth_scene(CAMERA, np.eye(3)), CAMERA, [420.0, 60.0, 520.0, 180.0], 96)
    seen = smooth_scene(crop.cameras.pinhole(0), crop.cameras.Rs_crop_camera[0].T)
    assert np.abs(crop.rgb[0].astype(int) - seen).max() <= 3


def test_crop_of_a_large_box_averages_pixels() -> None:
    checkers = np.repeat((np.indices((480, 640)).sum(0) % 2 * 255).astype(np.uint8)[..., None], 3, axis=-1)
    crop = crop_one(checkers, CAMERA, [100.0, 20.0, 540.0, 460.0], 32, padding=1.0)
    inner = crop.rgb[0, 2:-2, 2:-2]
    assert abs(int(inner.mean()) - 127) < 4
    assert inner.std() < 30


def test_downsampled_crop_still_shows_the_virtual_camera() -> None:
    camera = CAMERA.resized(1280, 960)
    crop = crop_one(smooth_scene(camera, np.eye(3)), camera, [300.0, 200.0, 600.0, 500.0], 64)
    seen = smooth_scene(crop.cameras.pinhole(0), crop.cameras.Rs_crop_camera[0].T)
    assert np.abs(crop.rgb[0].astype(int) - seen).max() <= 5


def test_one_pixel_of_the_mask_lands_in_its_own_place() -> None:
    camera = Pinhole(64, 64, 5000.0, 5000.0, 32.0, 32.0)
    mask = np.zeros((64, 64), bool)
    mask[20, 30] = True
    rgb = np.zeros((64, 64, 3), np.uint8)
    crop = crop_one(rgb, camera, [16.0, 16.0, 48.0, 48.0], 128, mask=mask, padding=1.0)
    assert crop.masks is not None
    # Every source pixel is four crop pixels wide: the centre at (30.5, 20.5) goes to (4 * 14.5, 4 * 4.5).
    rows, columns = np.nonzero(crop.masks[0])
    assert 9 <= len(rows) <= 16
    assert (columns.mean() + 0.5, rows.mean() + 0.5) == pytest.approx((58, 18), abs=0.3)


def test_enlarged_crop_shows_the_virtual_camera() -> None:
    camera = CAMERA.resized(160, 120)
    crop = crop_one(smooth_scene(camera, np.eye(3)), camera, [100.0, 20.0, 120.0, 35.0], 128)
    seen = smooth_scene(crop.cameras.pinhole(0), crop.cameras.Rs_crop_camera[0].T)
    assert np.abs(crop.rgb[0].astype(int) - seen).mean() < 1.5


def test_mask_follows_the_image() -> None:
    image = np.zeros((480, 640, 3), np.uint8)
    cv2.circle(image, (450, 100), 30, (255, 255, 255), -1)
    crop = crop_one(image, CAMERA, [400.0, 60.0, 500.0, 140.0], 128, mask=image[..., 0] > 0)
    assert crop.masks is not None
    np.testing.assert_array_equal(crop.masks[0], crop.rgb[0, ..., 0] > 127)


def test_outside_the_source_a_crop_is_black_and_unmasked() -> None:
    white = np.full((480, 640, 3), 255, np.uint8)
    crop = crop_one(white, CAMERA, [-60.0, 100.0, 60.0, 220.0], 64, mask=np.ones((480, 640), bool), padding=1.0)
    assert crop.masks is not None
    assert not crop.rgb[0, :, :28].any() and not crop.masks[0, :, :28].any()
    assert (crop.rgb[0, 4:-4, 36:] == 255).all() and crop.masks[0, 4:-4, 36:].all()


def test_batch_equals_single_crops() -> None:
    image = smooth_scene(CAMERA, np.eye(3))
    many = np.array([[10.0, 10.0, 60.0, 90.0], [300.0, 200.0, 500.0, 400.0]])
    masks = [image[..., 0] > 100, image[..., 1] > 100]
    batch = crop_images(image, CAMERA, many, 48, masks=masks)
    assert len(batch) == 2 and batch.masks is not None
    for i in range(2):
        single = crop_one(image, CAMERA, many[i], 48, mask=masks[i])
        assert single.masks is not None
        np.testing.assert_array_equal(batch.rgb[i], single.rgb[0])
        np.testing.assert_array_equal(batch.masks[i], single.masks[0])
        np.testing.assert_array_equal(batch.cameras.Rs_crop_camera[i], single.cameras.Rs_crop_camera[0])
        assert batch.cameras.pinhole(i) == single.cameras.pinhole(0)


def test_no_boxes_give_an_empty_batch() -> None:
    batch = crop_images(np.zeros((480, 640, 3), np.uint8), CAMERA, np.zeros((0, 4)), 48, masks=[])
    assert len(batch) == 0
    assert batch.rgb.shape == (0, 48, 48, 3)
    assert batch.masks is not None and batch.masks.shape == (0, 48, 48)


@pytest.mark.parametrize(
    ("box", "message"),
    [
        ([np.nan, 0, 10, 10], "box 1 must be finite numbers, got"),
        ([10, 10, 10, 20], r"box 1 must have x1 < x2 and y1 < y2 \(xyxy in pixels\)"),
        ([20, 10, 10, 20], "box 1 must have x1 < x2"),
        ([640, 10, 660, 20], "box 1 must overlap the image of 640 x 480 px"),
        ([10, -30, 20, -0.0], "box 1 must overlap the image of 640 x 480 px"),
    ],
)
def test_impossible_boxes_are_named(box: list[float], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        aim_virtual_cameras(CAMERA, np.array([[10.0, 10.0, 20.0, 20.0], box]), 64)


def test_a_box_beyond_a_right_angle_is_refused() -> None:
    wide = Pinhole.from_fovy(640, 480, 150.0)
    with pytest.raises(ConfigError, match="wider than a camera can see"):
        aim_virtual_cameras(wide, np.array([[600.0, 440.0, 4000.0, 4000.0]]), 64)


def test_an_image_of_another_size_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"image must be 640 x 480 px like its camera, got 320 x 240"):
        crop_one(np.zeros((240, 320, 3), np.uint8), CAMERA, [10.0, 10.0, 20.0, 20.0], 64)


def test_masks_must_match_boxes() -> None:
    with pytest.raises(ConfigError, match="one mask for each box, got 0 for 1 boxes"):
        crop_images(np.zeros((480, 640, 3), np.uint8), CAMERA, np.array([[1.0, 1.0, 9.0, 9.0]]), 64, masks=[])
