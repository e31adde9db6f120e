"""Colours count as far as they agree with the names that shapes suggest."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from simpick.assets.library import get_part
from simpick.estimators.detector.colours import cad_colours, colour_evidence, instance_colours

PARTS = np.array([[60.0, 0, 0], [60, 40, 0], [60, 0, 40], [60, -40, 0]])
NAMES = np.array([0, 1, 2, 3, 0, 1, 2, 3, 1])


def similarities() -> np.ndarray:
    """Shapes that name all but the last instance right, which is as similar to part 0 as to part 1."""
    similarity = np.full((len(NAMES), len(PARTS)), 0.5)
    similarity[np.arange(len(NAMES)), NAMES] = 0.9
    similarity[-1, :2] = 0.8
    return similarity


def evidence(colours: np.ndarray) -> np.ndarray:
    return colour_evidence(similarities(), np.ones(len(NAMES)), colours, PARTS)


def test_colours_that_agree_decide_between_parts_of_equal_shape() -> None:
    last = evidence(PARTS[NAMES])[-1]
    assert last[1] > last[0] + 0.05


@pytest.mark.parametrize("shift", [(-30.0, 0, 0), (0, 15, -10)])
def test_another_light_changes_nothing(shift: tuple[float, float, float]) -> None:
    np.testing.assert_allclose(evidence(PARTS[NAMES] + shift), evidence(PARTS[NAMES]), atol=1e-9)


def test_colours_that_do_not_agree_with_the_shapes_count_for_little() -> None:
    colours = np.random.default_rng(0).uniform(-60, 60, (len(NAMES), 3))
    assert np.abs(evidence(colours)).max() < 0.1 < np.ptp(similarities(), axis=1).min()
    assert np.array_equal((similarities() + evidence(colours))[:-1].argmax(axis=1), NAMES[:-1])


def test_parts_of_one_colour_get_no_evidence() -> None:
    same = np.repeat(PARTS[:1], len(PARTS), axis=0)
    given = colour_evidence(similarities(), np.ones(len(NAMES)), PARTS[NAMES], same)
    np.testing.assert_allclose(given, 0, atol=1e-12)
    assert colour_evidence(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)), PARTS[:3]).shape == (0, 3)


def test_the_colour_of_an_instance_is_that_of_its_inside() -> None:
    rgb = np.full((40, 40, 3), 255, np.uint8)
    rgb[11:19, 11:19] = (200, 30, 30)
    rgb[30, 30] = (30, 30, 200)
    large, small = np.zeros((40, 40), bool), np.zeros((40, 40), bool)
    large[10:20, 10:20] = True
    small[30, 30] = True
    expected = [
        cv2.cvtColor(np.array([[c]], np.float32) / 255, cv2.COLOR_RGB2LAB)[0, 0] for c in (rgb[15, 15], rgb[30, 30])
    ]
    np.testing.assert_allclose(instance_colours(rgb, [large, small]), expected, atol=1e-3)
    assert instance_colours(rgb, []).shape == (0, 3)


def test_the_colour_of_a_part_is_its_material() -> None:
    part = get_part("hex_nut")
    grey = replace(part, material=replace(part.material, rgb=(0.5, 0.5, 0.5)))
    first, second = cad_colours([part, grey])
    assert np.abs(second[1:]).max() < 0.01 < np.abs(first[1:]).max()
