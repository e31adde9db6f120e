"""Random bent parts: hooks, rings, brackets of rod or flat bar. Training parts, as those of `random_parts`."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from manifold3d import Manifold

from simpick.assets import csg as s
from simpick.assets.materials import Stock
from simpick.assets.part import Part
from simpick.assets.random_parts import (
    HEAVIEST_KG,
    LONGEST_MM,
    SHORTEST_MM,
    bounds,
    is_sound,
    random_convex,
    random_look,
)
from simpick.assets.symmetry_detection import detect_symmetries
from simpick.errors import ConfigError

# Keeps these draws apart from those of anything else that is seeded with the same small numbers.
_STREAM = 20_015
_PIECES = 11
"""Convex pieces of a bent bar; each is two segments of the solid."""


@lru_cache(maxsize=256)
def random_curve(seed: int) -> Part:
    """Return the random bent part of this seed, named ``curve_<seed>``; 25 to 90 mm long."""
    if seed < 0:
        raise ConfigError(f"seed must not be negative, got {seed}")
    rng = np.random.default_rng([_STREAM, seed])
    while True:
        solid, pieces = _attempt(rng)
        if is_sound(solid, pieces):
            break
    density = float(rng.choice([1050.0, 1200.0, 2700.0, 7800.0]))
    part = s.finish(f"curve_{seed}", solid, pieces, Stock(density, random_look(rng)))
    lightest = min(density, HEAVIEST_KG / float(part.mesh.volume))
    return replace(part, symmetries=detect_symmetries(part.mesh), density_kg_m3=lightest)


def _attempt(rng: np.random.Generator) -> tuple[Manifold, list[Manifold]]:
    """Return a solid in millimetres, not always a sound one, and its convex pieces."""
    path = _path(rng)
    radius = float(rng.uniform(0.05, 0.11)) * float(np.ptp(path, axis=0).max() + 10)
    if rng.random() < 0.5:
        knots = [Manifold.sphere(radius, 16).translate((float(x), float(y), 0.0)) for x, y in path]
    else:
        half = float(radius * rng.uniform(0.4, 1.2))
        knots = [s.cylinder(radius, -half, half, facets=20).translate((float(x), float(y), 0.0)) for x, y in path]
    solid = s.union(*[s.hull(a, b) for a, b in pairwise(knots)])
    pieces = [s.hull(*knots[k : k + 3]) for k in range(0, len(knots) - 1, 2)]
    if rng.random() < 0.5:
        size = radius / 12.0 * rng.uniform(1.0, 1.6)
        x, y = path[-1]
        head = random_convex(rng).scale((size, size, size)).translate((float(x), float(y), 0.0))
        solid, pieces = s.union(solid, head), [*pieces, head]
    low, high = bounds(solid)
    factor = float(rng.uniform(SHORTEST_MM, LONGEST_MM) / (high - low).max())
    scale = (factor, factor, factor)
    return solid.scale(scale), [piece.scale(scale) for piece in pieces]


def _path(rng: np.random.Generator) -> Float[np.ndarray, "points 2"]:
    """Return a plane path of straight lines and arcs, at equal steps; one time in four it begins with a ring."""
    lengths, curvatures = [], []
    for k in range(rng.integers(1, 4)):
        is_ring = k == 0 and rng.random() < 0.25
        if is_ring or rng.random() < 0.6:
            radius = rng.uniform(7.0, 18.0)
            angle = 2 * np.pi if is_ring else rng.uniform(np.pi / 4, 1.6 * np.pi)
            lengths.append(radius * angle)
            curvatures.append(rng.choice([-1, 1]) / radius)
        else:
            lengths.append(rng.uniform(12.0, 40.0))
            curvatures.append(0.0)
    fine = 400
    ends = np.cumsum(lengths)
    along = (np.arange(fine) + 0.5) / fine * ends[-1]
    heading = np.cumsum(np.array(curvatures)[np.searchsorted(ends, along)]) * ends[-1] / fine
    points = np.cumsum(np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0) * ends[-1] / fine
    return points[np.linspace(0, fine - 1, 2 * _PIECES + 1).round().astype(int)]
