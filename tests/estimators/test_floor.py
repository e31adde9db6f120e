"""The bin's floor bounds the depth of parts, where the frame says where it is."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest
import trimesh

from simpick.assets.library import get_part
from simpick.assets.part import Part
from simpick.estimators.floor import Floor
from simpick.estimators.refiner import Refiner
from simpick.estimators.refiner.alignment import moved
from simpick.geometry import Pinhole, box_of_mask, invert, so3_exp, transform
from simpick.records import CameraFrame, Detection, PoseEstimate, PoseHypothesis
from simpick.rendering import PartRenderer

# The camera looks down from 0.7 m, tilted by 0.15 rad.
T_WORLD_CAMERA = transform(so3_exp(np.array([np.pi - 0.15, 0.0, 0.0])), np.array([0.5, 0.1, 0.7]))
CAMERA = Pinhole(320, 240, 700.0, 700.0, 160.0, 120.0)


def lowest_m(part: Part, T_camera_part: np.ndarray) -> float:
    T = T_WORLD_CAMERA @ T_camera_part
    return float((part.mesh.vertices @ T[:3, :3].T + T[:3, 3])[:, 2].min())


def plate_with_a_hole() -> Part:
    """Return a plate of 50 x 40 x 6 mm with a hole beside its middle: thin, smooth, and alike from both sides."""
    plate = trimesh.creation.box((0.05, 0.04, 0.006))
    hole = trimesh.creation.cylinder(0.008, 0.02, sections=32)
    hole.apply_translation((0.01, 0.005, 0.0))
    return Part("plate_with_a_hole", plate.difference(hole), (plate,))


def resting(part: Part, height_m: float) -> np.ndarray:
    """Return a pose in the middle of the image, with the lowest point at this height."""
    T = transform(so3_exp(np.array([0.0, 0.0, 0.5])), np.array([0.52, 0.01, 0.05]))
    T[2, 3] += height_m - float((part.mesh.vertices @ T[:3, :3].T + T[:3, 3])[:, 2].min())
    return invert(T_WORLD_CAMERA) @ T


@pytest.mark.parametrize("height_m", [-0.01, -0.002, 0.001, 0.005])
def test_the_cost_of_height_falls_as_the_gradient_says(height_m):
    part = get_part("l_bracket")
    T, floor = resting(part, height_m), Floor(T_WORLD_CAMERA)
    T[:3, :3] = T[:3, :3] @ so3_exp(np.array([0.2, -0.3, 0.1]))
    R = so3_exp(np.array([0.05, -0.02, 0.0]))[None]
    Ts = transform(R) @ T
    gradient = 2 * floor.equations(part, Ts, R)[2][0].double().numpy()
    for k in range(6):
        costs = [
            float(floor.equations(part, moved(Ts, sign * 2e-4 * np.eye(6)[k : k + 1]), R)[0][0]) for sign in (1, -1)
        ]
        numeric = (costs[0] - costs[1]) / 4e-4
        assert gradient[k] == pytest.approx(numeric, rel=0.05, abs=0.02 * np.abs(gradient).max())


def test_the_floor_is_unknown_without_a_camera_pose_or_far_from_the_parts():
    part = get_part("l_bracket")
    frame = CameraFrame(np.zeros((240, 320, 3), np.uint8), CAMERA, T_WORLD_CAMERA)
    here = resting(part, 0.02)
    assert Floor.below(frame, [part], [here]) is not None
    assert Floor.below(dataclasses.replace(frame, T_world_camera=np.eye(4)), [part], [here]) is None
    elsewhere = T_WORLD_CAMERA.copy()
    elsewhere[2, 3] += 1.0
    assert Floor.below(dataclasses.replace(frame, T_world_camera=elsewhere), [part], [here]) is None


def test_poses_below_the_floor_are_raised_along_their_lines_of_sight():
    part = get_part("l_bracket")
    sunk, above = resting(part, -0.05), resting(part, 0.02)
    raised = Floor(T_WORLD_CAMERA).raised(part, np.stack([sunk, above]))
    assert lowest_m(part, raised[0]) == pytest.approx(0.0, abs=1e-6)
    assert np.cross(raised[0][:3, 3], sunk[:3, 3]) == pytest.approx(np.zeros(3), abs=1e-6)
    assert raised[1] == pytest.approx(above, abs=1e-9)


@pytest.mark.parametrize("depth_share", [-0.08, 0.1])
@pytest.mark.parametrize("grown_px", [-1, 1])
def test_a_plate_lies_on_the_floor_whatever_its_mask_says_of_its_depth(depth_share, grown_px):
    part = plate_with_a_hole()
    T_true = resting(part, 0.0)
    with PartRenderer(part, CAMERA.height, CAMERA.width) as renderer:
        views = renderer.render(T_true[None], CAMERA)
    assert views.rgb is not None
    seen = views.masks[0]
    rgb = np.where(seen[..., None], views.rgb[0], 90).astype(np.uint8)
    change = cv2.dilate if grown_px > 0 else cv2.erode
    side = 2 * abs(grown_px) + 1
    mask = change(seen.astype(np.uint8), np.ones((side, side), np.uint8)).astype(bool)
    off = T_true.copy()
    off[:3, 3] *= 1 + depth_share
    with Refiner() as refiner:
        refiner.onboard(part)
        frame = CameraFrame(rgb, CAMERA, T_WORLD_CAMERA)
        detection = Detection(part.name, box_of_mask(mask), mask, 1.0)
        ((best, *_),) = refiner.refine(frame, [detection], [[PoseHypothesis(off, 1.0)]])
    assert abs(lowest_m(part, best.T_camera_part)) < 3e-3
    assert np.linalg.norm(best.T_camera_part[:3, 3] - T_true[:3, 3]) < 12e-3


def estimates_of(part: Part, Ts: list[np.ndarray]) -> list[PoseEstimate]:
    hypotheses = tuple(PoseHypothesis(T, 0.5) for T in Ts)
    return [PoseEstimate(part.name, Ts[0], 0.5, "fine", 0.0, hypotheses)]


def test_estimates_below_the_floor_are_raised_with_all_their_hypotheses():
    part = get_part("l_bracket")
    frame = CameraFrame(np.zeros((240, 320, 3), np.uint8), CAMERA, T_WORLD_CAMERA)
    (estimate,) = Floor.under(frame, estimates_of(part, [resting(part, -0.02), resting(part, 0.01)]), {part.name: part})
    assert lowest_m(part, estimate.T_camera_part) == pytest.approx(0, abs=1e-4)
    below, above = estimate.hypotheses
    np.testing.assert_array_equal(below.T_camera_part, estimate.T_camera_part)
    np.testing.assert_allclose(above.T_camera_part, resting(part, 0.01), atol=1e-12)
    # Along the line of sight: the part stays where it is in the image.
    before, after = CAMERA.project(np.stack([resting(part, -0.02)[:3, 3], below.T_camera_part[:3, 3]]))
    np.testing.assert_allclose(after, before, atol=0.01)


def test_a_frame_without_estimates_has_none():
    frame = CameraFrame(np.zeros((240, 320, 3), np.uint8), CAMERA, T_WORLD_CAMERA)
    assert Floor.under(frame, [], {}) == [] and Floor.below(frame, [], []) is None


def test_estimates_stay_where_the_camera_is_not_calibrated():
    part = get_part("l_bracket")
    frame = CameraFrame(np.zeros((240, 320, 3), np.uint8), CAMERA, np.eye(4))
    given = estimates_of(part, [resting(part, -0.02)])
    assert Floor.under(frame, given, {part.name: part}) == given
