"""Depth rendered in a window is the depth of the whole image."""

import numpy as np
import pytest

from simpick.assets import get_part
from simpick.geometry import Pinhole, random_rotation, transform
from simpick.rendering import render_part_views
from simpick.rendering.posed_depth import PosedDepthRenderer

pytestmark = pytest.mark.render

CAMERA = Pinhole(320, 240, 480.0, 470.0, 155.0, 124.0)


def poses(positions_m: list[list[float]]) -> np.ndarray:
    rng = np.random.default_rng(0)
    Rs = np.stack([random_rotation(rng) for _ in positions_m])
    return transform(Rs, np.array(positions_m))


def test_a_window_holds_all_of_the_part_that_the_image_holds() -> None:
    part = get_part("pipe_tee")
    # In the middle, far away, beyond two borders, in a corner, and so near that it fills the image.
    Ts = poses([[0.0, 0.0, 0.9], [0.2, 0.1, 2.0], [-0.3, 0.0, 0.9], [0.0, 0.22, 0.9], [0.28, -0.23, 0.9], [0, 0, 0.1]])
    with PosedDepthRenderer() as renderer:
        # One by one, too, since the nearest decides how large the windows of a batch are.
        windowed = np.concatenate([renderer.render(part, T[None], CAMERA) for T in Ts])
        batch = renderer.render(part, Ts, CAMERA)
    whole = render_part_views(part, Ts, CAMERA, rgb=False).depth_m
    assert (whole > 0).any(axis=(1, 2)).all()
    for images in (windowed, batch):
        assert ((images > 0) != (whole > 0)).mean() < 1e-5
        both = (images > 0) & (whole > 0)
        np.testing.assert_allclose(images[both], whole[both], atol=1e-4)


def test_poses_behind_the_camera_beside_the_image_or_not_finite_give_empty_images() -> None:
    part = get_part("pipe_tee")
    Ts = poses([[0.0, 0.0, -0.9], [5.0, 0.0, 0.9], [0.0, -5.0, 0.9], [0.0, 0.0, 0.9]])
    Ts[3, 0, 0] = np.nan
    with PosedDepthRenderer() as renderer:
        assert not renderer.render(part, Ts, CAMERA).any()
        assert renderer.render(part, Ts[:0], CAMERA).shape == (0, 240, 320)
