import numpy as np

from simpick.geometry import box_of_mask, window_of_mask


def test_a_box_ends_behind_the_last_pixel():
    mask = np.zeros((6, 9), bool)
    mask[2, 3] = mask[4, 5] = True
    np.testing.assert_array_equal(box_of_mask(mask), [3, 2, 6, 5])


def test_an_empty_mask_has_a_box_without_area():
    np.testing.assert_array_equal(box_of_mask(np.zeros((6, 9), bool)), [0, 0, 0, 0])


def test_a_window_holds_the_mask_and_its_margin_as_far_as_the_image_reaches() -> None:
    mask = np.zeros((6, 9), bool)
    mask[1:5, 3:6] = True
    assert mask[window_of_mask(mask, 0)].all()
    assert mask[window_of_mask(mask, 2)].shape == (6, 7)
