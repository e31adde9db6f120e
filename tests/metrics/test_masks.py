"""Figures of masks, against pycocotools and values by hand."""

import contextlib
import io

import numpy as np
import pytest
from pycocotools import mask as coco_mask
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from simpick.metrics.mask_scores import MaskScores
from simpick.metrics.masks import FALSE, IGNORED, MaskOverlaps, mask_overlaps, match_masks, merged_count, split_count

SIZE = 64


def squares(*corners: tuple[int, int, int, int]) -> np.ndarray:
    masks = np.zeros((len(corners), SIZE, SIZE), bool)
    for mask, (top, left, bottom, right) in zip(masks, corners, strict=True):
        mask[top:bottom, left:right] = True
    return masks


def overlaps(masks: np.ndarray, truths: np.ndarray, *, scores: tuple = (), visible: tuple = ()) -> MaskOverlaps:
    return mask_overlaps(
        masks, np.array(scores or np.linspace(0.9, 0.6, len(masks))), truths, np.array(visible or np.ones(len(truths)))
    )


def random_image(rng: np.random.Generator) -> MaskOverlaps:
    corners = [(r, c, r + 12, c + 12) for r in (2, 18, 34, 50) for c in (2, 18, 34, 50)]
    truths = squares(*corners)
    shifted = np.stack([np.roll(t, rng.integers(-4, 5, size=2), axis=(0, 1)) for t in truths])
    kept = rng.random(len(truths)) < 0.8
    extra = np.roll(truths[rng.random(len(truths)) < 0.3], 8, axis=1)
    masks = np.concatenate([shifted[kept], extra])
    return mask_overlaps(masks, rng.random(len(masks)), truths, np.ones(len(truths)))


def coco_precisions(images: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> tuple[float, float, float]:
    """Return AP, AP50 and AP75 of (masks, scores, truths) as pycocotools computes them."""
    annotations, results = [], []
    for k, (masks, scores, truths) in enumerate(images):
        for mask in truths:
            rle = coco_mask.encode(np.asfortranarray(mask.astype(np.uint8)))
            annotations.append(
                {"id": len(annotations) + 1, "image_id": k, "category_id": 1, "segmentation": rle, "iscrowd": 0}
                | {"area": float(mask.sum()), "bbox": list(map(float, coco_mask.toBbox(rle)))}
            )
        for mask, score in zip(masks, scores, strict=True):
            rle = coco_mask.encode(np.asfortranarray(mask.astype(np.uint8)))
            results.append({"image_id": k, "category_id": 1, "segmentation": rle, "score": float(score)})
    with contextlib.redirect_stdout(io.StringIO()):
        coco = COCO()
        coco.dataset = {  # pyright: ignore[reportAttributeAccessIssue]
            "images": [{"id": k, "height": SIZE, "width": SIZE} for k in range(len(images))],
            "annotations": annotations,
            "categories": [{"id": 1, "name": "part"}],
        }
        coco.createIndex()
        found = coco.loadRes(results)  # pyright: ignore[reportArgumentType]
        evaluation = COCOeval(coco, found, "segm")
        evaluation.evaluate()
        evaluation.accumulate()
        evaluation.summarize()
    ap, ap50, ap75 = (float(v) for v in evaluation.stats[:3])
    return ap, ap50, ap75


def test_average_precision_agrees_with_pycocotools() -> None:
    rng = np.random.default_rng(5)
    found, images = [], []
    for _ in range(4):
        corners = [(r, c, r + 12, c + 12) for r in (2, 18, 34, 50) for c in (2, 18, 34, 50)]
        truths = squares(*corners)
        shifted = np.stack([np.roll(t, rng.integers(-4, 5, size=2), axis=(0, 1)) for t in truths])
        masks = np.concatenate([shifted[rng.random(16) < 0.8], np.roll(truths[rng.random(16) < 0.3], 8, axis=1)])
        scores = rng.random(len(masks))
        images.append((masks, scores, truths))
        found.append(mask_overlaps(masks, scores, truths, np.ones(16)))
    figures = MaskScores(found).figures()
    assert (figures.ap, figures.ap50, figures.ap75) == pytest.approx(coco_precisions(images), abs=1e-6)


def test_perfect_masks_have_perfect_figures() -> None:
    truths = squares((0, 0, 10, 10), (20, 20, 40, 40))
    figures = MaskScores([overlaps(truths, truths)]).figures()
    assert (figures.ap, figures.ap50, figures.pq, figures.recall, figures.iou) == pytest.approx((1, 1, 1, 1, 1))
    assert figures.merges == figures.splits == 0


def test_the_better_score_takes_an_instance_that_two_detections_claim() -> None:
    truth = squares((0, 0, 20, 20))
    twice = squares((0, 0, 20, 18), (0, 0, 20, 20))
    assert list(match_masks(overlaps(twice, truth, scores=(0.9, 0.8)), 0.5)) == [0, FALSE]


def test_hardly_visible_instances_count_neither_for_nor_against() -> None:
    truths = squares((0, 0, 10, 10), (20, 20, 30, 30))
    image = overlaps(truths, truths, visible=(1.0, 0.1))
    assert list(match_masks(image, 0.5)) == [0, IGNORED]
    assert MaskScores([image]).figures().ap == pytest.approx(1)


def test_merges_and_splits_are_counted() -> None:
    truths = squares((0, 0, 20, 20), (0, 20, 20, 40))
    assert merged_count(overlaps(squares((0, 0, 20, 40)), truths)) == 1
    halves = squares((0, 0, 10, 20), (10, 0, 20, 20))
    assert split_count(overlaps(halves, truths)) == 1
    assert merged_count(overlaps(halves, truths)) == 0


def test_panoptic_quality_ignores_detections_of_low_score() -> None:
    truths = squares((0, 0, 10, 10))
    masks = squares((0, 0, 10, 10), (30, 30, 40, 40))
    assert MaskScores([overlaps(masks, truths, scores=(0.9, 0.3))]).figures().pq == pytest.approx(1)
    assert MaskScores([overlaps(masks, truths, scores=(0.9, 0.6))]).figures().pq == pytest.approx(1 / 1.5)


def test_weights_count_images_as_often_as_they_say() -> None:
    rng = np.random.default_rng(0)
    images = [random_image(rng) for _ in range(3)]
    weighted = MaskScores(images).figures(np.array([2.0, 0.0, 1.0]))
    repeated = MaskScores([images[0], images[0], images[2]]).figures()
    assert weighted.ap == pytest.approx(repeated.ap) and weighted.pq == pytest.approx(repeated.pq)


def test_an_image_without_detections_or_instances_is_allowed() -> None:
    nothing = np.zeros((0, SIZE, SIZE), bool)
    truths = squares((0, 0, 10, 10))
    missed, empty = overlaps(nothing, truths), overlaps(nothing, nothing)
    assert MaskScores([missed, empty]).figures().ap == 0
    assert np.isnan(MaskScores([empty]).figures().ap)
