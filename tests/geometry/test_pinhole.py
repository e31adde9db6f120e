"""The pinhole camera's conventions, by round trip and by hand."""

import numpy as np
import pytest

from simpick.errors import ConfigError
from simpick.geometry import Pinhole, opencv_from_mujoco_camera

CAMERA = Pinhole(640, 480, 600.0, 610.0, 315.0, 244.0)


def test_back_projection_inverts_projection() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform([-1, -1, 0.5], [1, 1, 2], (4, 5, 3))
    np.testing.assert_allclose(CAMERA.back_project(CAMERA.project(points), points[..., 2]), points, atol=1e-12)


def test_K_projects_homogeneous_points() -> None:
    point = np.array([0.1, -0.2, 0.8])
    homogeneous = CAMERA.K @ point
    np.testing.assert_allclose(CAMERA.project(point), homogeneous[:2] / homogeneous[2])


def test_image_spans_zero_to_width_about_a_centred_principal_point() -> None:
    camera = Pinhole.from_fovy(640, 480, 60.0)
    assert camera.fovy_deg == pytest.approx(60)
    top_edge = camera.project(np.array([0.0, -np.tan(np.radians(30)), 1.0]))
    np.testing.assert_allclose(top_edge, [320, 0], atol=1e-9)


def test_rays_pass_through_pixel_centres() -> None:
    rays = CAMERA.rays()
    assert rays.shape == (480, 640, 3)
    np.testing.assert_allclose(CAMERA.project(rays[7, 3]), [3.5, 7.5])


def test_resizing_scales_pixels_and_keeps_rays() -> None:
    half = CAMERA.resized(320, 240)
    point = np.array([0.1, -0.2, 0.8])
    np.testing.assert_allclose(half.project(point), CAMERA.project(point) / 2)


def test_from_K_round_trips() -> None:
    assert Pinhole.from_K(640, 480, CAMERA.K) == CAMERA


def test_mujoco_cameras_look_along_minus_z_with_y_up() -> None:
    T_world_camera = opencv_from_mujoco_camera(np.eye(4))
    np.testing.assert_array_equal(T_world_camera[:3, 2], [0, 0, -1])
    np.testing.assert_array_equal(T_world_camera[:3, 1], [0, -1, 0])
    np.testing.assert_array_equal(opencv_from_mujoco_camera(T_world_camera), np.eye(4))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0, 480, 1.0, 1.0, 0.0, 0.0), "width must be at least 1, got 0"),
        ((640, 480, -1.0, 1.0, 0.0, 0.0), "fx must be above 0, got -1.0"),
        ((640, 480, float("nan"), 1.0, 0.0, 0.0), "fx must be a finite number, got nan"),
        ((640, 480, 1.0, 1.0, float("inf"), 0.0), "cx must be a finite number, got inf"),
    ],
)
def test_impossible_cameras_are_refused(arguments: tuple, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Pinhole(*arguments)


def test_a_skewed_K_is_refused() -> None:
    with pytest.raises(ConfigError, match="K must be"):
        Pinhole.from_K(640, 480, np.array([[600.0, 1.0, 320.0], [0, 600.0, 240.0], [0, 0, 1.0]]))


def test_impossible_field_of_view_is_refused() -> None:
    with pytest.raises(ConfigError, match="fovy must be between 0 and 180 degrees, got 180"):
        Pinhole.from_fovy(640, 480, 180.0)


@pytest.mark.parametrize("entry", [(0, 1), (1, 0), (2, 0), (2, 1), (2, 2)])
def test_other_matrices_than_a_pinholes_are_refused(entry: tuple[int, int]) -> None:
    K = np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]])
    K[entry] += 1e-6
    with pytest.raises(ConfigError, match=r"K must be \[\[fx, 0, cx\]"):
        Pinhole.from_K(640, 480, K)


@pytest.mark.parametrize("fovy_deg", [0.0, -1.0, 180.0])
def test_a_field_of_view_is_between_0_and_180_degrees(fovy_deg: float) -> None:
    with pytest.raises(ConfigError, match="fovy must be between 0 and 180 degrees"):
        Pinhole.from_fovy(640, 480, fovy_deg)
    assert Pinhole.from_fovy(640, 480, 0.5).fy > 5e4
