"""Every format of camera file, against OpenCV's own projection, and what is wrong with a file."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from simpick.errors import CameraFileError
from simpick.photos import Calibration, read_calibration

FX, FY, CX, CY = 812.5, 799.25, 301.75, 260.5
SIZE = (640, 480)
D = (-0.21, 0.08, 0.001, -0.0007, 0.01)
FISHEYE = (0.05, -0.01, 0.003, -0.0005)
K = np.array([[FX, 0, CX], [0, FY, CY], [0, 0, 1.0]])
MATRIX = f"  rows: 3\n  cols: 3\n  data: {K.ravel().tolist()}\n"


def opencv_yaml(folder: Path) -> Path:
    path = folder / "opencv.yaml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", SIZE[0])
    storage.write("image_height", SIZE[1])
    storage.write("camera_matrix", K)
    storage.write("distortion_coefficients", np.array([D]))
    storage.release()
    return path


def opencv_json(folder: Path) -> Path:
    path = folder / "opencv.json"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("camera_matrix", K)
    storage.write("dist_coeffs", np.array([D]))
    storage.release()
    return path


def plain_json(folder: Path) -> Path:
    path = folder / "plain.json"
    path.write_text(json.dumps({"mtx": K.tolist(), "dist": [list(D)], "image_size": list(SIZE)}))
    return path


def ros_file(folder: Path) -> Path:
    path = folder / "ros.yaml"
    path.write_text(
        f"image_width: {SIZE[0]}\nimage_height: {SIZE[1]}\ncamera_name: left\ncamera_matrix:\n{MATRIX}"
        f"distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: {list(D)}\n"
        "projection_matrix:\n  rows: 3\n  cols: 4\n  data: [700, 0, 310, 0, 0, 701, 250, 0, 0, 0, 1, 0]\n"
    )
    return path


def ros_message(folder: Path) -> Path:
    path = folder / "message.yaml"
    path.write_text(
        f"header:\n  frame_id: camera\nheight: {SIZE[1]}\nwidth: {SIZE[0]}\ndistortion_model: plumb_bob\n"
        f"d: {list(D)}\nk: {K.ravel().tolist()}\n---\n"
    )
    return path


def bop(folder: Path) -> Path:
    path = folder / "camera.json"
    path.write_text(json.dumps({"fx": FX, "fy": FY, "cx": CX, "cy": CY, "width": 640, "height": 480, "depth_scale": 1}))
    return path


def realsense(folder: Path) -> Path:
    path = folder / "realsense.json"
    intrinsics = {"width": 640, "height": 480, "fx": FX, "fy": FY, "ppx": CX, "ppy": CY}
    intrinsics |= {"model": "distortion.brown_conrady", "coeffs": list(D)}
    path.write_text(json.dumps({"color": intrinsics}))
    return path


FORMATS = {
    "OpenCV YAML": (opencv_yaml, SIZE, D),
    "OpenCV JSON": (opencv_json, None, D),
    "plain JSON": (plain_json, SIZE, D),
    "ROS file": (ros_file, SIZE, D),
    "ROS message": (ros_message, SIZE, D),
    "BOP": (bop, SIZE, ()),
    "RealSense": (realsense, SIZE, D),
}


@pytest.mark.parametrize("name", FORMATS)
def test_points_project_as_opencv_projects_them(name: str, tmp_path: Path) -> None:
    write, size, distortion = FORMATS[name]
    calibration = read_calibration(write(tmp_path))
    assert calibration.size == size and calibration.distortion == pytest.approx(distortion)
    points = np.random.default_rng(0).uniform([-0.15, -0.12, 0.7], [0.15, 0.12, 0.9], (50, 3))
    pixels = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, np.array(distortion or [0.0] * 4))[0][:, 0]
    camera = calibration.of_size(*SIZE)
    # OpenCV's pixel (0, 0) is the centre of the first pixel, which is (0.5, 0.5) in simpick.
    np.testing.assert_allclose(camera.points(pixels + 0.5), camera.camera.project(points), atol=2e-3)


def test_fisheye_points_project_as_opencv_projects_them(tmp_path: Path) -> None:
    path = ros_file(tmp_path)
    text = path.read_text().replace("plumb_bob", "equidistant").replace("cols: 5", "cols: 4")
    path.write_text(text.replace(str(list(D)), str(list(FISHEYE))))
    points = np.random.default_rng(0).uniform([-0.2, -0.2, 0.7], [0.2, 0.2, 0.9], (50, 1, 3))
    pixels = cv2.fisheye.projectPoints(points, np.zeros(3), np.zeros(3), K, np.array(FISHEYE))[0][:, 0]
    calibration = read_calibration(path)
    assert calibration.lens == "fisheye"
    camera = calibration.of_size(*SIZE)
    np.testing.assert_allclose(camera.points(pixels + 0.5), camera.camera.project(points[:, 0]), atol=1e-3)


def test_four_numbers_with_and_without_the_half_pixel() -> None:
    assert Calibration.from_K(K).of_size(*SIZE).camera.cx == CX + 0.5
    shifted = np.add(K, [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    assert pytest.approx(shifted) == Calibration.from_K(shifted, pixel_centres="half").of_size(*SIZE).camera.K


def test_rectified_images_of_ros_have_the_projection_matrix(tmp_path: Path) -> None:
    calibration = read_calibration(ros_file(tmp_path), rectified=True)
    assert (calibration.fx, calibration.cy, calibration.is_distorted) == (700, 250, False)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ({"foo": 1}, "no camera matrix among its keys (foo)"),
        ({"camera_matrix": [[1, 2], [3, 4]]}, "must have 3 x 3 numbers, got 4"),
        ({"camera_matrix": "wide"}, "must hold finite numbers, got 'wide'"),
        ({"camera_matrix": (K * [[1], [-1], [1]]).tolist()}, "with positive fx and fy"),
        (
            {"camera_matrix": K.tolist(), "dist": [0.1] * 6},
            "must have 0 or 4 or 5 or 8 or 12 or 14 coefficients, got 6",
        ),
        ({"K": K.ravel().tolist(), "distortion_model": "magic", "D": []}, "must be one of plumb_bob"),
        ({"fx": 1, "fy": 1, "ppx": 1, "ppy": 1, "model": "Ftheta", "coeffs": [1, 0, 0, 0, 0]}, "got 'Ftheta'"),
        ({"K": K.tolist(), "width": 0, "height": 0}, "whole numbers of pixels from 1 to 100000, got [0.0, 0.0]"),
        ([1, 2], "must hold named values, got a list"),
    ],
)
def test_what_is_wrong_is_named(content: object, problem: str, tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(content))
    with pytest.raises(CameraFileError) as error:
        read_calibration(path)
    assert problem in str(error.value) and "camera.json" in str(error.value)


def test_missing_and_unreadable_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(CameraFileError, match=r"no camera file .*four numbers FX FY CX CY"):
        read_calibration(tmp_path / "no.yaml")
    (tmp_path / "bad.yaml").write_text("a: [1, 2")
    with pytest.raises(CameraFileError, match="is neither JSON nor YAML"):
        read_calibration(tmp_path / "bad.yaml")


@pytest.mark.parametrize(
    ("size", "problem"),
    [
        ((1280, 960), "If the image was resized by 2, these are its fx fy cx cy: 1625 1598.5 604 521.5"),
        ((480, 640), "turned by 90 degrees"),
        ((600, 480), "If it was cropped, subtract the crop's corner"),
    ],
)
def test_an_image_of_another_size_is_refused(size: tuple[int, int], problem: str) -> None:
    with pytest.raises(CameraFileError) as error:
        Calibration.from_K(K, size=SIZE).of_size(*size)
    assert problem in str(error.value) and f"got {size[0]} x {size[1]} px" in str(error.value)


def test_without_a_stated_size_a_principal_point_far_off_is_refused_and_an_odd_one_taken() -> None:
    with pytest.raises(CameraFileError, match="state width and height in a camera file"):
        Calibration.from_K(K).of_size(2560, 1920)
    odd = Calibration.from_K(np.array([[FX, 0, 100.0], [0, FY, 400.0], [0, 0, 1]]))
    assert odd.of_size(*SIZE).camera.cx == 100.5


def test_a_size_that_is_no_two_numbers_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    path.write_text(json.dumps({"mtx": K.tolist(), "dist": [list(D)], "image_size": [[], 480]}))
    with pytest.raises(CameraFileError, match="key 'image_size': must hold finite numbers, got \\[\\]"):
        read_calibration(path)
