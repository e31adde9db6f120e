"""Outlines move to the image's edges, and no further."""

import numpy as np

from simpick.estimators.detector.outlines import sharpen_outlines


def test_outlines_move_to_the_edge_of_the_object() -> None:
    truth = np.zeros((60, 80), bool)
    truth[20:40, 30:50] = True
    rgb = np.where(truth[..., None], (200, 180, 40), (30, 40, 60)).astype(np.uint8)
    rough = np.roll(truth, (1, -1), axis=(0, 1))
    (sharp,) = sharpen_outlines(rgb, [rough])
    assert (sharp & truth).sum() / (sharp | truth).sum() > (rough & truth).sum() / (rough | truth).sum()
    assert (sharp != truth).sum() <= 20


def test_masks_stay_disjoint_and_near_what_they_were() -> None:
    rng = np.random.default_rng(0)
    rgb = rng.integers(0, 255, (60, 80, 3)).astype(np.uint8)
    first, second = np.zeros((2, 60, 80), bool)
    first[10:40, 10:40], second[10:40, 40:60] = True, True
    sharp = sharpen_outlines(rgb, [first, second])
    assert not (sharp[0] & sharp[1]).any()
    for before, after in zip((first, second), sharp, strict=True):
        assert after[13:37, before[20].argmax() + 3 : before[20].argmax() + 15].all()
        assert abs(int(after.sum()) - int(before.sum())) < 0.4 * before.sum()


def test_thin_masks_survive() -> None:
    rgb = np.zeros((40, 40, 3), np.uint8)
    line = np.zeros((40, 40), bool)
    line[20, 5:35] = True
    rgb[line] = 255
    (sharp,) = sharpen_outlines(rgb, [line])
    assert sharp.any()


def test_nothing_in_gives_nothing() -> None:
    assert sharpen_outlines(np.zeros((8, 8, 3), np.uint8), []) == []
