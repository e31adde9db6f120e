"""Boxes get the mask of the instance that fills them."""

from dataclasses import replace

import numpy as np
import pytest

from simpick.estimators.detector import boxed_instances
from simpick.estimators.detector.boxed_instances import with_instances
from simpick.geometry import box_of_mask
from simpick.records import CameraFrame, Detection
from simpick.rendering import SceneRenderer
from simpick.scene import build_scene
from tests.small_scenes import small_scene


@pytest.fixture(scope="module")
def frame() -> CameraFrame:
    with SceneRenderer(build_scene(small_scene("hex_bolt", "l_bracket", count=3, width_px=640, height_px=480), 4)) as r:
        return r.capture("overhead")


@pytest.fixture(scope="module")
def truths(frame: CameraFrame) -> list[np.ndarray]:
    assert frame.instances is not None
    return [frame.instances == k for k in range(3)]


def box_of(mask: np.ndarray) -> Detection:
    return Detection("part", box_of_mask(mask), None, 1.0)


def test_a_box_gets_the_mask_of_what_fills_it(frame: CameraFrame, truths: list[np.ndarray]) -> None:
    for truth, found in zip(truths, with_instances(frame, [box_of(t) for t in truths]), strict=True):
        assert found.mask is not None
        assert (found.mask & truth).sum() > 0.9 * (found.mask | truth).sum()


def test_masks_are_kept_and_boxes_that_nothing_fills_stay_boxes(frame: CameraFrame, truths: list[np.ndarray]) -> None:
    masked = replace(box_of(truths[0]), mask=truths[1])
    x1, y1, x2, y2 = box_of_mask(truths[0])
    twice = replace(box_of(truths[0]), box_xyxy_px=np.array([x1, y1, 2 * x2 - x1, y2]))
    nowhere = replace(masked, mask=None, box_xyxy_px=np.full(4, np.nan))
    empty = replace(masked, mask=None, box_xyxy_px=np.array([5.0, 5.0, 5.0, 5.0]))
    found = with_instances(frame, [masked, twice, nowhere, empty])
    assert found[0] is masked
    assert [d.mask for d in found[1:]] == [None, None, None]


def test_only_the_image_is_read(frame: CameraFrame, truths: list[np.ndarray]) -> None:
    boxes = [box_of(truth) for truth in truths]
    bare = replace(frame, depth_m=None, instances=None)
    for a, b in zip(with_instances(frame, boxes), with_instances(bare, boxes), strict=True):
        assert a.mask is not None and b.mask is not None and np.array_equal(a.mask, b.mask)


def test_an_image_is_segmented_once_and_only_for_boxes(
    frame: CameraFrame, truths: list[np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    shared = boxed_instances._shared_segmentation()
    segmented = []
    segment = shared._segmenter.segment
    monkeypatch.setattr(shared, "_seen", None)
    monkeypatch.setattr(shared._segmenter, "segment", lambda rgb: segmented.append(1) or segment(rgb))
    with_instances(frame, [replace(box_of(truths[0]), mask=truths[0])])
    assert not segmented
    with_instances(frame, [box_of(truths[0])])
    with_instances(frame, [box_of(truths[1])])
    assert len(segmented) == 1
    with_instances(replace(frame, rgb=255 - frame.rgb), [box_of(truths[1])])
    assert len(segmented) == 2


@pytest.mark.parametrize("height", [8, 31])
def test_an_image_too_small_to_segment_keeps_its_boxes(height: int, frame: CameraFrame) -> None:
    box = Detection("part", np.array([1.0, 1.0, 6.0, 6.0]), None, 1.0)
    camera = replace(frame.camera, height=height)
    assert with_instances(CameraFrame(frame.rgb[:height], camera, frame.T_world_camera), [box]) == [box]


def test_an_image_without_instances_keeps_its_boxes(frame: CameraFrame) -> None:
    box = Detection("part", np.array([1.0, 1.0, 60.0, 60.0]), None, 1.0)
    (found,) = with_instances(replace(frame, rgb=np.full_like(frame.rgb, 90)), [box])
    assert found.mask is None
