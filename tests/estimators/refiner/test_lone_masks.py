"""A detection is alone where no other mask comes near its own."""

from __future__ import annotations

import numpy as np
import pytest
from jaxtyping import Bool

from simpick.estimators.refiner.lone_masks import are_alone


def block(left: int, top: int, width: int = 40, height: int = 20) -> Bool[np.ndarray, "120 160"]:
    mask = np.zeros((120, 160), bool)
    mask[top : top + height, left : left + width] = True
    return mask


# A part of 40 px reaches 6 px.
@pytest.mark.parametrize(("gap_px", "alone"), [(0, False), (4, False), (10, True)])
def test_a_part_is_alone_beyond_a_share_of_its_length(gap_px, alone):
    first, second = block(20, 50), block(60 + gap_px, 50)
    assert are_alone([first, second], [first, second]).tolist() == [alone, alone]


def test_a_long_part_is_near_where_a_short_one_is_alone():
    long, short = block(10, 50, 100, 10), block(60, 70, 12, 12)
    assert are_alone([long, short], [long, short]).tolist() == [False, True]


def test_nearness_is_between_masks_not_between_boxes():
    corner = block(20, 20, 60, 4) | block(20, 20, 4, 60)
    inside = block(58, 58, 20, 20)
    assert are_alone([corner], [corner, inside]).tolist() == [True]


def test_detections_that_are_not_refined_are_neighbours_too():
    asked, other = block(20, 50), block(62, 50)
    assert are_alone([asked], [asked]).tolist() == [True]
    assert are_alone([asked], [asked, other]).tolist() == [False]


def test_two_detections_of_the_same_pixels_are_not_alone():
    assert are_alone([block(20, 50)], [block(20, 50), block(20, 50)]).tolist() == [False]


def test_masks_at_the_images_edge_have_their_neighbours():
    corner, beside = block(0, 0), block(43, 0)
    far = block(120, 100)
    assert are_alone([corner, beside, far], [corner, beside, far]).tolist() == [False, False, True]
