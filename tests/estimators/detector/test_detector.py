"""What `LearnedDetector` finds in a simple bin, what it reads of a frame, and what it does with bad input."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from simpick.assets.library import get_part
from simpick.errors import CheckpointError, ConfigError
from simpick.estimators.base import Detector, ForegroundDetector
from simpick.estimators.detector import AlikePartsWarning, LearnedDetector
from simpick.estimators.detector import detector as detector_module
from simpick.estimators.detector.detector import LearnedDetectorConfig
from simpick.estimators.raypose.checkpoints import shipped_checkpoint
from simpick.geometry import Pinhole
from simpick.records import CameraFrame, Detection
from tests.estimators.detector.conftest import SeenBin

pytestmark = pytest.mark.render


@pytest.fixture(scope="module")
def detector() -> LearnedDetector:
    torch.set_num_threads(1)
    return LearnedDetector()


@pytest.fixture(scope="module")
def found(detector: LearnedDetector, seen_bin: SeenBin) -> list[Detection]:
    return detector.detect(seen_bin.frame, seen_bin.parts)


def mask_of(detection: Detection) -> np.ndarray:
    assert detection.mask is not None
    return detection.mask


def iou(first: np.ndarray, second: np.ndarray) -> float:
    return float((first & second).sum() / (first | second).sum())


def is_same(first: list[Detection], second: list[Detection]) -> bool:
    return len(first) == len(second) and all(
        a.part == b.part and a.score == b.score and np.array_equal(mask_of(a), mask_of(b))
        for a, b in zip(first, second, strict=True)
    )


def test_it_is_a_detector(detector: LearnedDetector) -> None:
    assert isinstance(detector, Detector)


def test_the_foreground_shows_every_part_and_costs_nothing_after_detection(
    detector: LearnedDetector, seen_bin: SeenBin, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert isinstance(detector, ForegroundDetector)
    frame = CameraFrame(seen_bin.frame.rgb, seen_bin.frame.camera, np.eye(4))
    detector.detect(frame, seen_bin.parts)
    with monkeypatch.context() as patched:
        patched.setattr(detector.segmenter, "maps", None)
        foreground = detector.foreground(frame)
    ids = seen_bin.frame.instances
    assert ids is not None and iou(foreground, ids >= 0) > 0.9
    other = replace(frame, rgb=np.full_like(frame.rgb, 90))
    assert not detector.foreground(other).any()
    np.testing.assert_array_equal(detector.foreground(frame), foreground)


def test_parts_that_lie_apart_are_found_and_named(found: list[Detection], seen_bin: SeenBin) -> None:
    ids = seen_bin.frame.instances
    assert ids is not None
    right = 0
    for k, name in enumerate(seen_bin.names):
        truth = ids == k
        best = max(found, key=lambda d: iou(mask_of(d), truth))
        right += iou(mask_of(best), truth) > 0.5 and best.part == name
    assert right >= len(seen_bin.names) - 1


def test_detections_are_complete_and_in_order(found: list[Detection]) -> None:
    scores = [detection.score for detection in found]
    assert scores == sorted(scores, reverse=True)
    for detection in found:
        assert 0 <= detection.score <= 1 and detection.instance is None
        rows, columns = np.nonzero(mask_of(detection))
        box = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        np.testing.assert_allclose(detection.box_xyxy_px, box)


def test_neither_depth_nor_instances_are_read(
    detector: LearnedDetector, found: list[Detection], seen_bin: SeenBin
) -> None:
    frame = seen_bin.frame
    bare = CameraFrame(frame.rgb, frame.camera, frame.T_world_camera)
    assert bare.depth_m is None and bare.instances is None
    assert is_same(detector.detect(bare, seen_bin.parts), found)


def test_the_distance_is_that_of_the_floor_where_the_camera_pose_is_known(
    detector: LearnedDetector, found: list[Detection], seen_bin: SeenBin
) -> None:
    frame, masks = seen_bin.frame, [mask_of(detection) for detection in found]
    foreign = [get_part("crane_hook")]
    named = detector.naming.compare(frame, masks, foreign)
    eye_m = float(frame.T_world_camera[2, 3])
    assert named.is_distance_known and eye_m - 0.1 < named.distance_m < 1.1 * eye_m
    unknown = replace(frame, T_world_camera=np.eye(4))
    free = detector.naming.compare(unknown, masks, foreign)
    assert not free.is_distance_known and (free.similarity.mean() > named.similarity.mean())


def test_parts_of_another_size_are_less_similar_where_the_distance_is_known(
    detector: LearnedDetector, seen_bin: SeenBin
) -> None:
    # From twice as high, what looks like these parts is twice as large.
    frame, higher = seen_bin.frame, seen_bin.frame.T_world_camera.copy()
    higher[2, 3] *= 2
    right, larger, unknown = (
        detector.compare(replace(frame, T_world_camera=T), seen_bin.parts)
        for T in (frame.T_world_camera, higher, np.eye(4))
    )
    assert right.is_distance_known and larger.is_distance_known and not unknown.is_distance_known
    means = [compared.similarity.max(axis=1).mean() for compared in (right, larger, unknown)]
    assert means[1] < means[0] - 0.03 and means[2] > means[0] - 0.01


def test_permuting_the_simulator_ids_changes_nothing(
    detector: LearnedDetector, found: list[Detection], seen_bin: SeenBin
) -> None:
    ids = seen_bin.frame.instances
    assert ids is not None
    permuted = np.append(np.random.default_rng(0).permutation(len(seen_bin.names)), -1).astype(np.int32)[ids]
    assert (permuted != ids).any()
    assert is_same(detector.detect(replace(seen_bin.frame, instances=permuted), seen_bin.parts), found)


@pytest.mark.parametrize("absent", ["bushing", "l_bracket"])
def test_a_bin_without_the_asked_part_gives_an_empty_answer(
    detector: LearnedDetector, seen_bin: SeenBin, absent: str
) -> None:
    assert detector.detect(seen_bin.frame, [get_part(absent)]) == []


def test_no_parts_and_an_empty_image_give_an_empty_list(detector: LearnedDetector, seen_bin: SeenBin) -> None:
    assert detector.detect(seen_bin.frame, []) == []
    grey = replace(seen_bin.frame, rgb=np.full_like(seen_bin.frame.rgb, 90))
    assert detector.detect(grey, seen_bin.parts) == []


def test_an_image_without_colour_is_answered(detector: LearnedDetector, seen_bin: SeenBin) -> None:
    luminance = seen_bin.frame.rgb.mean(axis=2).astype(np.uint8)
    grey = replace(seen_bin.frame, rgb=np.repeat(luminance[..., None], 3, axis=2))
    assert detector.detect(grey, seen_bin.parts)


def test_an_image_of_another_size_shows_the_same_parts(
    detector: LearnedDetector, found: list[Detection], seen_bin: SeenBin
) -> None:
    rgb, c = seen_bin.frame.rgb, seen_bin.frame.camera
    half = rgb.reshape(c.height // 2, 2, c.width // 2, 2, 3).mean(axis=(1, 3)).astype(np.uint8)
    camera = Pinhole(c.width // 2, c.height // 2, c.fx / 2, c.fy / 2, c.cx / 2, c.cy / 2)
    small = detector.detect(CameraFrame(half, camera, np.eye(4)), seen_bin.parts)
    assert all(mask_of(d).shape == (c.height // 2, c.width // 2) for d in small)
    agreeing = [any(d.part == f.part and iou(mask_of(d), mask_of(f)[::2, ::2]) > 0.5 for d in small) for f in found]
    assert sum(agreeing) >= len(found) - 1


def test_colours_can_be_left_out(seen_bin: SeenBin, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[np.ndarray] = []

    def no_evidence(similarity: np.ndarray, *others: np.ndarray) -> np.ndarray:
        asked.append(similarity)
        return np.zeros(similarity.shape)

    monkeypatch.setattr(detector_module, "colour_evidence", no_evidence)
    shapes = LearnedDetector(config=LearnedDetectorConfig(colours=False)).detect(seen_bin.frame, seen_bin.parts)
    assert shapes and not asked
    assert is_same(LearnedDetector().detect(seen_bin.frame, seen_bin.parts), shapes) and len(asked) == 1


def test_views_are_compared_with_one_part_too(
    detector: LearnedDetector, found: list[Detection], seen_bin: SeenBin, monkeypatch: pytest.MonkeyPatch
) -> None:
    compare, alone = detector.view_naming.compare, seen_bin.parts[:1]
    before = detector.detect(seen_bin.frame, alone)
    monkeypatch.setattr(detector.view_naming, "compare", lambda *arguments: compare(*arguments) - 20)
    assert before and not is_same(detector.detect(seen_bin.frame, alone), before)
    assert not is_same(detector.detect(seen_bin.frame, seen_bin.parts), found)


def test_an_image_of_another_size_than_its_camera_is_refused(detector: LearnedDetector, seen_bin: SeenBin) -> None:
    frame = seen_bin.frame
    small = CameraFrame(np.ascontiguousarray(frame.rgb[::2, ::2]), frame.camera, frame.T_world_camera)
    with pytest.raises(ConfigError, match="image must be 640 x 480 px like its camera, got 320 x 240"):
        detector.detect(small, seen_bin.parts)


def test_parts_that_look_alike_are_reported_once(detector: LearnedDetector, seen_bin: SeenBin) -> None:
    nut = get_part("hex_nut")
    twins = [nut, replace(nut, name="hex_nut_copy")]
    with pytest.warns(AlikePartsWarning, match="look alike.*: hex_nut and hex_nut_copy"):
        detector.detect(seen_bin.frame, twins)
    # A second warning would be an error in these tests.
    detector.detect(seen_bin.frame, twins)


def test_weights_of_another_network_are_refused() -> None:
    with pytest.raises(CheckpointError, match="must be a checkpoint of simpick's detector"):
        LearnedDetector(shipped_checkpoint())
