"""Random bent parts: sound, of the promised size, and the same for the same seed."""

import numpy as np
import pytest

from simpick.assets.random_curves import random_curve
from simpick.assets.random_parts import HEAVIEST_KG, LONGEST_MM, SHORTEST_MM
from simpick.errors import ConfigError


@pytest.mark.parametrize("seed", range(6))
def test_bent_parts_are_watertight_and_of_the_promised_size(seed: int) -> None:
    part = random_curve(seed)
    assert part.name == f"curve_{seed}"
    assert part.mesh.is_watertight and len(part.mesh.split()) == 1
    assert SHORTEST_MM - 0.01 <= 1000 * part.mesh.extents.max() <= LONGEST_MM + 0.01
    assert part.density_kg_m3 * part.mesh.volume <= HEAVIEST_KG + 1e-6


def test_the_same_seed_gives_the_same_part() -> None:
    first = random_curve(3)
    random_curve.cache_clear()
    np.testing.assert_array_equal(first.mesh.vertices, random_curve(3).mesh.vertices)


def test_bent_parts_are_no_convex_bodies() -> None:
    filled = [random_curve(seed).mesh.volume / random_curve(seed).mesh.convex_hull.volume for seed in range(6)]
    assert np.median(filled) < 0.75


def test_a_negative_seed_is_refused() -> None:
    with pytest.raises(ConfigError, match="seed must not be negative, got -1"):
        random_curve(-1)
