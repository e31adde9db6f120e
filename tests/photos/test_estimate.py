"""`simpick.estimate` against the closed loop and the truth, in the frame and unit of the CAD file."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

import simpick
from simpick import Perception, load_estimator
from simpick.assets import get_part
from simpick.assets.part import Part
from simpick.errors import CameraFileError, ConfigError, ImageFileError, UnknownNameError
from simpick.estimators import SegmentationDetector
from simpick.geometry import Pinhole, invert, so3_exp, transform, transform_points
from simpick.photos import Calibration, PhotoEstimator
from simpick.records import CameraFrame, Detection
from simpick.rendering import PartRenderer

CAMERA = Pinhole(200, 160, 310.0, 296.0, 88.25, 91.5)
"""An odd principal point and pixels that are not square."""
K_OPENCV = CAMERA.K - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]


@pytest.fixture(scope="module")
def cad(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bracket drawn in millimetres far from the origin, and turned."""
    wall = trimesh.creation.box((6, 30, 24), transform(None, np.array([17.0, 0, 9])))
    solid = trimesh.boolean.union([trimesh.creation.box((40, 30, 6)), wall])
    solid.apply_transform(transform(so3_exp(np.array([0.3, 0.2, 0.1])), np.array([900.0, -1200.0, 3100.0])))
    path = tmp_path_factory.mktemp("cad") / "bracket.stl"
    solid.export(path)
    return path


@pytest.fixture(scope="module")
def frame(cad: Path) -> tuple[CameraFrame, np.ndarray]:
    """Return a rendered image with instance ids, and the pose of the part in it."""
    T_camera_part = transform(so3_exp(np.array([2.2, 0.4, -0.3])), np.array([0.012, -0.02, 0.3]))
    with PartRenderer(get_part(cad), CAMERA.height, CAMERA.width) as renderer:
        views = renderer.render(T_camera_part[None], CAMERA)
    assert views.rgb is not None
    rgb = np.where(views.masks[0][..., None], views.rgb[0], np.uint8(90))
    instances = np.where(views.masks[0], 0, -1).astype(np.int32)
    return CameraFrame(rgb, CAMERA, np.eye(4), views.depth_m[0], instances), T_camera_part


def detections(frame: CameraFrame, part: Part) -> list[Detection]:
    return SegmentationDetector(instance_parts=[part.name]).detect(frame, [part])


def test_the_pose_is_that_of_the_closed_loop_in_the_cad_frame(cad: Path, frame: tuple[CameraFrame, np.ndarray]) -> None:
    seen, _ = frame
    part = get_part(cad)
    perception = Perception("retrieval", SegmentationDetector(instance_parts=[part.name]), load_estimator("retrieval"))
    perception.onboard([part])
    (inside,) = perception.perceive(seen, [part]).estimates
    (outside,) = simpick.estimate(seen.rgb, K_OPENCV, cad, mode="retrieval", detections=detections(seen, part))
    np.testing.assert_allclose(outside.T_camera_cad @ part.T_cad_part, inside.T_camera_part, atol=1e-9)
    np.testing.assert_allclose(outside.T_camera_part, inside.T_camera_part, atol=1e-9)


def test_the_files_own_coordinates_project_where_the_part_is(cad: Path, frame: tuple[CameraFrame, np.ndarray]) -> None:
    seen, T_camera_part = frame
    part = get_part(cad)
    answers = simpick.estimate(
        seen.rgb, K_OPENCV, [cad], mode="retrieval_refined", detections=detections(seen, part), count=1
    )
    vertices_mm = np.asarray(trimesh.load_mesh(cad).vertices)
    R, t = answers[0].T_camera_cad_units[:3, :3], answers[0].T_camera_cad_units[:3, 3]
    pixels = cv2.projectPoints(vertices_mm, cv2.Rodrigues(R)[0], t, K_OPENCV, None)[0][:, 0]
    truth = CAMERA.project(transform_points(T_camera_part @ invert(part.T_cad_part), vertices_mm / 1000)) - 0.5
    assert np.abs(pixels - truth).max() < 0.5
    assert answers[0].metres_per_cad_unit == 1e-3


def test_the_half_pixel_shifts_the_pose_by_half_a_pixel(cad: Path, frame: tuple[CameraFrame, np.ndarray]) -> None:
    seen, _ = frame
    found = detections(seen, get_part(cad))
    same = simpick.estimate(seen.rgb, CAMERA.K, cad, mode="retrieval", detections=found, pixel_centres="half")
    right = simpick.estimate(seen.rgb, K_OPENCV, cad, mode="retrieval", detections=found)
    np.testing.assert_allclose(same[0].T_camera_part, right[0].T_camera_part, atol=1e-9)
    wrong = simpick.estimate(seen.rgb, CAMERA.K, cad, mode="retrieval", detections=found)
    shift_px = CAMERA.project(right[0].T_camera_part[:3, 3]) - CAMERA.project(wrong[0].T_camera_part[:3, 3])
    assert shift_px == pytest.approx([0.5, 0.5], abs=0.05)


def test_a_distorted_image_gives_the_pose_of_the_straight_one(cad: Path, frame: tuple[CameraFrame, np.ndarray]) -> None:
    seen, T_camera_part = frame
    lens = (-0.3, 0.1, 0.001, 0.001)
    y, x = np.mgrid[: CAMERA.height, : CAMERA.width].astype(float)
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)[:, None]
    straight = cv2.undistortPoints(pixels, K_OPENCV, np.array(lens), R=np.eye(3), P=K_OPENCV)
    map_x, map_y = np.moveaxis(straight.astype(np.float32).reshape(CAMERA.height, CAMERA.width, 2), 2, 0)
    rgb = cv2.remap(seen.rgb, map_x, map_y, cv2.INTER_LINEAR)
    mask = cv2.remap((seen.instances == 0).astype(np.uint8) * 255, map_x, map_y, cv2.INTER_LINEAR) > 127
    calibration = Calibration.from_K(K_OPENCV, distortion=lens)
    found = [Detection(get_part(cad).name, np.array([0.0, 0, 1, 1]), mask, 1.0)]
    (answer,) = simpick.estimate(rgb, calibration, cad, mode="retrieval_refined", detections=found)
    error_px = CAMERA.project(answer.T_camera_part[:3, 3]) - CAMERA.project(T_camera_part[:3, 3])
    assert np.abs(error_px).max() < 0.5
    assert np.linalg.norm(answer.T_camera_part[:3, 3] - T_camera_part[:3, 3]) < 2e-3


def test_a_box_gets_a_mask_and_the_checks_speak_for_a_good_pose(
    cad: Path, frame: tuple[CameraFrame, np.ndarray]
) -> None:
    seen, _ = frame
    part = get_part(cad)
    box = detections(seen, part)[0].box_xyxy_px
    camera = Calibration.from_K(K_OPENCV).of_size(CAMERA.width, CAMERA.height)
    with PhotoEstimator([part], "retrieval_refined") as estimator:
        poses = estimator.estimate(seen.rgb, camera, [Detection(part.name, box, None, 1.0)])
        (checks,) = estimator.checks(poses)
    mask, truth = poses.detections[0].mask, seen.instances == 0
    assert mask is not None and (mask & truth).sum() / (mask | truth).sum() > 0.93
    assert checks.edge_agreement > 0.8 and checks.mask_agreement > 0.9
    assert not [reason for reason in checks.reasons if "pose" not in reason]


def test_what_does_not_fit_is_named(cad: Path, frame: tuple[CameraFrame, np.ndarray], tmp_path: Path) -> None:
    rgb = frame[0].rgb
    with pytest.raises(CameraFileError, match="does not suit an image of 200 x 160 px"):
        simpick.estimate(rgb, np.array([[900.0, 0, 640], [0, 900, 360], [0, 0, 1]]), cad)
    with pytest.raises(ConfigError, match=r"must be of uint8, .*, got \(160, 200, 4\) of uint16"):
        simpick.estimate(np.zeros((160, 200, 4), np.uint16), K_OPENCV, cad)
    with pytest.raises(ImageFileError, match="no image, video or folder"):
        simpick.estimate(tmp_path / "no.png", K_OPENCV, cad)
    with pytest.raises(UnknownNameError, match="no estimator named 'best'"):
        simpick.estimate(rgb, K_OPENCV, cad, mode="best")
