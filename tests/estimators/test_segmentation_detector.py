import numpy as np
import pytest
import trimesh

from simpick.assets.part import Part
from simpick.errors import ConfigError, UnknownNameError
from simpick.estimators import Detector
from simpick.estimators.detection_noise import DetectionNoise, ragged
from simpick.estimators.segmentation_detector import SegmentationDetector
from simpick.geometry import Pinhole
from simpick.records import CameraFrame

BOX = trimesh.creation.box((0.02, 0.02, 0.02))
NUT, BOLT = (Part(name, BOX, (BOX,)) for name in ("nut", "bolt"))
NAMES = ("nut", "bolt", "nut", "bolt")


@pytest.fixture
def frame() -> CameraFrame:
    """Instances 0 and 1 touch; 2 is the largest; 3 has four pixels."""
    instances = np.full((80, 100), -1, np.int32)
    instances[10:30, 10:30] = 0
    instances[10:30, 30:42] = 1
    instances[40:70, 50:90] = 2
    instances[2:4, 2:4] = 3
    return CameraFrame(np.zeros((80, 100, 3), np.uint8), Pinhole.from_fovy(100, 80, 40.0), np.eye(4), None, instances)


def detector(noise: DetectionNoise | str = "perfect", seed=0, **settings) -> SegmentationDetector:
    return SegmentationDetector(noise, np.random.default_rng(seed), instance_parts=NAMES, **settings)


def detected(detections):
    return [d.instance for d in detections]


def test_perfect_detections_are_the_visible_masks_largest_first(frame):
    detections = SegmentationDetector(instance_parts=NAMES).detect(frame, [NUT, BOLT])
    assert detected(detections) == [2, 0, 1]
    assert [d.part for d in detections] == ["nut", "nut", "bolt"]
    np.testing.assert_array_equal(detections[1].mask, frame.instances == 0)
    np.testing.assert_array_equal(detections[1].box_xyxy_px, [10, 10, 30, 30])
    assert [d.score for d in detections] == [1.0, 400 / 1200, 240 / 1200]


def test_only_parts_asked_for_are_detected(frame):
    assert detected(detector().detect(frame, [BOLT])) == [1]
    assert detected(detector(min_visible_px=4).detect(frame, [BOLT])) == [1, 3]


def test_it_is_a_detector_and_asks_a_changing_scene_each_time(frame):
    names = ["nut"] * 4
    changing = SegmentationDetector(instance_parts=lambda: names)
    assert isinstance(changing, Detector)
    assert len(changing.detect(frame, [NUT])) == 3
    names[0] = "bolt"
    assert detected(changing.detect(frame, [NUT])) == [2, 1]


def test_the_same_seed_gives_the_same_noise_and_another_seed_another(frame):
    def masks(seed):
        return [d.mask for d in detector("realistic", seed).detect(frame, [NUT, BOLT])]

    first, again, other = masks(4), masks(4), masks(5)
    assert all((a == b).all() for a, b in zip(first, again, strict=True))
    assert any((a != b).any() for a, b in zip(first, other, strict=False))


def test_misses_come_as_often_as_asked_for(frame):
    noisy = detector(DetectionNoise(miss=0.3))
    counts = [len(noisy.detect(frame, [NUT, BOLT])) for _ in range(300)]
    assert np.mean(counts) == pytest.approx(3 * 0.7, abs=0.15)


def test_merging_gives_one_detection_of_both_masks(frame):
    detections = detector(DetectionNoise(merge=1.0)).detect(frame, [NUT, BOLT])
    assert detected(detections) == [2, 0]
    np.testing.assert_array_equal(detections[1].mask, np.isin(frame.instances, [0, 1]))
    np.testing.assert_array_equal(detections[1].box_xyxy_px, [10, 10, 42, 30])


def test_ragged_outlines_wander_by_about_their_deviation_and_keep_the_area(frame):
    mask = frame.instances == 2
    rough = [ragged(mask, 1.5, np.random.default_rng(k)) for k in range(30)]
    changed = np.mean([(r ^ mask).sum() for r in rough])
    outline_px = 2 * (30 + 40)
    # The mean absolute deviation of a normal distribution is 0.8 of its standard deviation.
    assert changed / outline_px == pytest.approx(0.8 * 1.5, rel=0.25)
    assert np.mean([r.sum() for r in rough]) == pytest.approx(mask.sum(), rel=0.05)


def test_jittered_boxes_stay_in_the_image(frame):
    noisy = detector(DetectionNoise(box_jitter=0.25), min_visible_px=4)
    for _ in range(50):
        for d in noisy.detect(frame, [NUT, BOLT]):
            x1, y1, x2, y2 = d.box_xyxy_px
            assert 0 <= x1 < x2 <= 100 and 0 <= y1 < y2 <= 80


def test_wrong_settings_are_explained(frame):
    with pytest.raises(UnknownNameError, match=r"no detection preset named 'good'. Valid: box, perfect, realistic\."):
        detector("good")
    with pytest.raises(ConfigError, match=r"need a random generator: pass rng=numpy.random.default_rng\(seed\)"):
        SegmentationDetector("realistic", instance_parts=NAMES)
    with pytest.raises(ConfigError, match=r"miss must be between 0 and 1, got 2"):
        DetectionNoise(miss=2)
    with pytest.raises(ConfigError, match=r"shows instance 3, but parts of only 2 are given"):
        SegmentationDetector(instance_parts=NAMES[:2]).detect(frame, [NUT])
    with pytest.raises(ConfigError, match=r"need a frame with instance ids: capture\(..., instances=True\)"):
        bare = CameraFrame(frame.rgb, frame.camera, frame.T_world_camera)
        detector().detect(bare, [NUT])
