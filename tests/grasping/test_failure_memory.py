"""Failed attempts: where, how, and while the image shows the same."""

import numpy as np
import pytest

from simpick.assets.library import get_part
from simpick.geometry.transforms import transform
from simpick.grasping import FailureMemory, View

T_TCP = transform(translation=np.array([0.5, 0.0, 0.01]))


def at(x_m: float) -> np.ndarray:
    return transform(translation=np.array([0.5 + x_m, 0.0, 0.01]))


def test_the_surroundings_are_8_px_wide() -> None:
    outline = np.zeros((60, 80), bool)
    outline[25:35, 35:45] = True
    region = View.of(np.zeros((60, 80, 3), np.uint8), outline).region
    assert region[17:43, 27:53].all() and region.sum() == 26**2


def test_a_grasp_that_failed_is_ruled_out_and_others_are_worth_less() -> None:
    nut, memory = get_part("hex_nut"), FailureMemory()
    memory.remember(nut, at(0), T_TCP)
    factors = memory.factors(nut, at(0), np.stack([T_TCP, at(0.03)]))
    assert factors[0] == 0 and factors[1] == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("name", "near_m", "far_m"),
    [
        ("hex_nut", 0.0110, 0.0125),  # 0.3 times its diameter of 39 mm.
        ("crane_hook", 0.0145, 0.0155),  # 66 mm: at most 15 mm count.
    ],
)
def test_the_same_place_depends_on_the_part_s_size(name: str, near_m: float, far_m: float) -> None:
    part, memory = get_part(name), FailureMemory()
    memory.remember(part, at(0), T_TCP)
    assert memory.factors(part, at(near_m), T_TCP[None]) == 0
    assert memory.factors(part, at(far_m), T_TCP[None]) == 1


@pytest.mark.parametrize(("levels", "pixels", "differs"), [(13, 4, True), (12, 4, False), (13, 3, False)])
def test_more_than_12_levels_on_more_than_3_percent_are_a_change(levels: int, pixels: int, differs: bool) -> None:
    before, region = np.full((60, 80, 3), 100, np.uint8), np.zeros((60, 80), bool)
    region[10:20, 5:15] = True
    region[10, 5 : 5 + pixels], region[10, 70 : 70 + pixels] = False, True
    after = before.copy()
    after[:, 60:] += levels
    assert View(View.of(before, region).luminance, region).differs_from(after) == differs
