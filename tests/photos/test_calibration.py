"""Undistortion: what a pinhole would have seen comes back, to a fraction of a pixel."""

import cv2
import numpy as np
import pytest

from simpick.photos import Calibration
from simpick.photos.calibration import LensModel

K = np.array([[520.0, 0, 330.0], [0, 500.0, 225.0], [0, 0, 1.0]])
LENSES: dict[LensModel, tuple[float, ...]] = {
    "brown_conrady": (-0.25, 0.07, 0.001, -0.001),
    "fisheye": (-0.02, 0.004, -0.001, 0.0002),
}


def distorted(image: np.ndarray, lens: LensModel) -> np.ndarray:
    """Return what a camera with this lens sees of what a pinhole sees as `image`."""
    height, width = image.shape[:2]
    y, x = np.mgrid[:height, :width].astype(np.float64)
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)[:, None]
    undistort = cv2.fisheye.undistortPoints if lens == "fisheye" else cv2.undistortPoints
    straight = undistort(pixels, K, np.array(LENSES[lens]), R=np.eye(3), P=K)[:, 0]
    map_x, map_y = np.moveaxis(straight.astype(np.float32).reshape(height, width, 2), 2, 0)
    return cv2.remap(image, map_x, map_y, cv2.INTER_LINEAR)


@pytest.mark.parametrize("lens", LENSES)
def test_the_pinhole_image_comes_back(lens: LensModel) -> None:
    yy, xx = np.mgrid[:450, :640]
    image = np.zeros((450, 640, 3), np.uint8)
    image[..., 0] = 255 * ((xx - 420) ** 2 + (yy - 300) ** 2 < 60**2)
    image[..., 1] = 255 * ((xx - 150) ** 2 + (yy - 120) ** 2 < 40**2)
    calibration = Calibration(520.0, 500.0, 330.0, 225.0, 640, 450, lens, LENSES[lens])
    seen = calibration.of_size(640, 450).frame(distorted(image, lens)).rgb
    for channel, centre in ((0, (420, 300)), (1, (150, 120))):
        mask = seen[..., channel] > 127
        assert np.array([xx[mask].mean(), yy[mask].mean()]) == pytest.approx(centre, abs=0.05)
        assert mask.sum() == pytest.approx((image[..., channel] > 127).sum(), rel=0.01)


@pytest.mark.parametrize("lens", LENSES)
def test_boxes_and_masks_move_with_the_image(lens: LensModel) -> None:
    mask = np.zeros((450, 640), bool)
    mask[300:380, 480:590] = True
    camera = Calibration(520.0, 500.0, 330.0, 225.0, 640, 450, lens, LENSES[lens]).of_size(640, 450)
    bent = camera.mask(mask)
    rows, columns = np.flatnonzero(bent.any(axis=1)), np.flatnonzero(bent.any(axis=0))
    box = camera.box(np.array([480.0, 300.0, 590.0, 380.0]))
    assert box == pytest.approx([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], abs=1.0)
    assert np.abs(box - [480, 300, 590, 380]).max() > 3, "the lens moves the box"


def test_without_distortion_pixels_stay_as_they_are() -> None:
    image = np.random.default_rng(0).integers(0, 255, (450, 640, 3), np.uint8)
    camera = Calibration.from_K(K).of_size(640, 450)
    assert np.array_equal(camera.frame(image).rgb, image)
    assert camera.box(np.array([1.0, 2, 3, 4])).tolist() == [1, 2, 3, 4]
