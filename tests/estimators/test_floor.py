"""The bin's floor bounds the depth of parts, where the frame says where it is."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest
import torch
import trimesh

import simpick.estimators.floor
from simpick.assets.library import get_part
from simpick.assets.part import Part
from simpick.estimators.floor import UNKNOWN_REST, Floor
from simpick.estimators.refiner import Refiner
from simpick.estimators.refiner.alignment import moved
from simpick.estimators.refiner.confidence import FEATURES
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


def plate_image(part: Part, T_camera_part: np.ndarray) -> tuple[CameraFrame, Detection]:
    """Return an image of the plate alone, and its perfect detection."""
    with PartRenderer(part, CAMERA.height, CAMERA.width) as renderer:
        views = renderer.render(T_camera_part[None], CAMERA)
    assert views.rgb is not None
    mask = views.masks[0]
    rgb = np.where(mask[..., None], views.rgb[0], 90).astype(np.uint8)
    return CameraFrame(rgb, CAMERA, T_WORLD_CAMERA), Detection(part.name, box_of_mask(mask), mask, 1.0)


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


def tilted(part: Part, tilt_deg: float, height_m: float = 0.0) -> np.ndarray:
    """Return a pose tilted out of the resting one about a slanted horizontal axis, the lowest point at this height."""
    T = T_WORLD_CAMERA @ resting(part, 0.0)
    T[:3, :3] = so3_exp(np.radians(tilt_deg) * np.array([0.8, 0.6, 0.0])) @ T[:3, :3]
    T[2, 3] += height_m - float((part.mesh.vertices @ T[:3, :3].T + T[:3, 3])[:, 2].min())
    return invert(T_WORLD_CAMERA) @ T


def tilt_deg(T_camera_part: np.ndarray) -> float:
    """Return the angle between the floor's normal and the z axis of the part, either way up."""
    return float(np.degrees(np.arccos(min(1.0, abs((T_WORLD_CAMERA @ T_camera_part)[2, 2])))))


@pytest.mark.parametrize("tilt", [2.0, 10.0, 25.0, 60.0])
@pytest.mark.parametrize("height_m", [-0.003, 0.001, 0.006])
def test_the_cost_of_tilt_falls_as_the_gradient_says(tilt, height_m, monkeypatch):
    # The pull into stable poses alone, and the lowest corner: the gradient of a soft minimum is approximate.
    for name, value in (("_SOFTNESS_M", 1e-6), ("_BELOW_WEIGHT", 0.0), ("_REST_WEIGHT", 0.0)):
        monkeypatch.setattr(simpick.estimators.floor, name, value)
    part = plate_with_a_hole()
    R = so3_exp(np.array([0.05, -0.02, 0.3]))[None]
    Ts, floor = transform(R) @ tilted(part, tilt, height_m), Floor(T_WORLD_CAMERA)
    gradient = 2 * floor.equations(part, Ts, R)[2][0, :3].double().numpy()
    for k in range(3):
        costs = [
            float(floor.equations(part, moved(Ts, sign * 2e-4 * np.eye(6)[k : k + 1]), R)[0][0]) for sign in (1, -1)
        ]
        numeric = (costs[0] - costs[1]) / 4e-4
        assert gradient[k] == pytest.approx(numeric, rel=0.02, abs=0.01 * np.abs(gradient).max())


@pytest.mark.parametrize("tilt", [4.0, 12.0, 20.0])
def test_a_step_down_the_floors_cost_lays_a_tilted_part_flat(tilt):
    part, floor = plate_with_a_hole(), Floor(T_WORLD_CAMERA)
    T = tilted(part, tilt)
    _, H, g = floor.equations(part, T[None], np.eye(3)[None])
    turn = -torch.linalg.solve(H[:, :3, :3] + 1e-3 * torch.eye(3), g[:, :3, None])[0, :, 0].double().numpy()
    after = moved(T[None], 0.2 * np.concatenate([turn, np.zeros(3)])[None])
    assert tilt_deg(after[0]) < 0.9 * tilt_deg(T)


def test_a_part_far_above_the_floor_or_far_out_of_rest_is_left_alone():
    part, floor = plate_with_a_hole(), Floor(T_WORLD_CAMERA)

    def pull(T: np.ndarray) -> float:
        return float(floor.equations(part, T[None], np.eye(3)[None])[2].abs().max())

    assert pull(tilted(part, 10.0, 0.05)) < 0.02 * pull(tilted(part, 10.0))
    assert pull(tilted(part, 45.0, 0.05)) < 0.02 * pull(tilted(part, 10.0))


def test_rest_is_one_in_a_stable_pose_and_falls_with_tilt_and_height():
    part, floor = plate_with_a_hole(), Floor(T_WORLD_CAMERA)
    upside_down = tilted(part, 180.0)
    poses = [resting(part, 0.0), upside_down, tilted(part, 10.0), resting(part, 0.004), tilted(part, 40.0, 0.04)]
    flat, turned, leaning, floating, neither = floor.rest(part, np.stack(poses))
    assert flat == pytest.approx(1.0, abs=1e-3) and turned == pytest.approx(1.0, abs=1e-3)
    # Half of it is lost at the scales of tilt and height.
    assert leaning == pytest.approx(0.5, abs=0.02) and floating == pytest.approx(0.5, abs=0.02)
    assert 0 < neither < 0.01


def test_a_part_without_stable_poses_has_no_tilt(monkeypatch):
    monkeypatch.setattr(simpick.estimators.floor, "resting_directions", lambda part: np.zeros((0, 3)))
    part, floor = plate_with_a_hole(), Floor(T_WORLD_CAMERA)
    flat, leaning = floor.rest(part, np.stack([resting(part, 0.0), tilted(part, 30.0)]))
    assert flat == pytest.approx(1.0, abs=1e-3) and leaning == pytest.approx(1.0, abs=1e-2)


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
    frame, seen = plate_image(part, T_true)
    assert seen.mask is not None
    change = cv2.dilate if grown_px > 0 else cv2.erode
    side = 2 * abs(grown_px) + 1
    mask = change(seen.mask.astype(np.uint8), np.ones((side, side), np.uint8)).astype(bool)
    off = T_true.copy()
    off[:3, 3] *= 1 + depth_share
    with Refiner() as refiner:
        refiner.onboard(part)
        detection = Detection(part.name, box_of_mask(mask), mask, 1.0)
        ((best, *_),) = refiner.refine(frame, [detection], [[PoseHypothesis(off, 1.0)]])
    assert abs(lowest_m(part, best.T_camera_part)) < 3e-3
    assert np.linalg.norm(best.T_camera_part[:3, 3] - T_true[:3, 3]) < 12e-3


@pytest.mark.parametrize("tilt", [-12.0, 12.0])
def test_a_plate_on_the_floor_is_laid_flat_although_its_outline_hardly_tells_its_tilt(tilt):
    part = plate_with_a_hole()
    frame, detection = plate_image(part, resting(part, 0.0))
    with Refiner() as refiner:
        refiner.onboard(part)
        ((best, *_),) = refiner.refine(frame, [detection], [[PoseHypothesis(tilted(part, tilt), 1.0)]])
    assert tilt_deg(best.T_camera_part) < 1.0


def rest_cues(frame: CameraFrame, detections: list[Detection], part: Part, Ts: list[np.ndarray]) -> list[float]:
    """Return the resting cue of the first pose of the first detection and of all others that it may have."""
    with Refiner() as refiner:
        refiner.onboard(part)
        starts = [[PoseHypothesis(T, 1.0) for T in Ts], *([] for _ in detections[1:])]
        found = refiner.finalists(frame, detections, starts)[0]
    assert found is not None
    return [float(finalist.cues[FEATURES.index("rest")]) for finalist in found]


def test_a_lone_plate_is_judged_by_whether_it_rests():
    part = plate_with_a_hole()
    frame, detection = plate_image(part, resting(part, 0.0))
    leaning, *others = rest_cues(frame, [detection], part, [tilted(part, 30.0)])
    assert leaning < 0.2 and max(others) > 0.95


def test_rest_is_no_evidence_where_the_floor_is_unknown_or_others_are_near():
    part = plate_with_a_hole()
    frame, detection = plate_image(part, resting(part, 0.0))
    start = [tilted(part, 30.0)]
    uncalibrated = dataclasses.replace(frame, T_world_camera=np.eye(4))
    assert set(rest_cues(uncalibrated, [detection], part, start)) == {UNKNOWN_REST}
    _, y1, x2, y2 = detection.box_xyxy_px.astype(int)
    beside = np.zeros(frame.rgb.shape[:2], bool)
    beside[y1:y2, x2 + 2 : x2 + 30] = True
    neighbour = Detection(part.name, box_of_mask(beside), beside, 1.0)
    assert set(rest_cues(frame, [detection, neighbour], part, start)) == {UNKNOWN_REST}


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
