"""Random parts by constructive solid geometry: the world that estimators are trained in.

Library parts and user CAD are never trained on; nothing here copies them. A seed makes the same part everywhere.
"""

from __future__ import annotations

import colorsys
from dataclasses import replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float
from manifold3d import CrossSection, Manifold

from simpick.assets import csg as s
from simpick.assets.materials import Stock
from simpick.assets.part import Material, Part
from simpick.assets.symmetry_detection import detect_symmetries
from simpick.errors import ConfigError

SHORTEST_MM, LONGEST_MM = 25.0, 90.0
"""Range of the longest side."""
HEAVIEST_KG = 0.25
"""A part that would be heavier is made of something lighter."""
_THINNEST_MM = 3.5
_SMALLEST_MM3 = 2000.0
_PREFIX = "random_"
# Keeps these draws apart from those of anything else that is seeded with the same small numbers.
_STREAM = 20_010


def seed_from_name(name: str) -> int | None:
    """Return the seed of a random part's name (``random_<seed>``), None for any other name."""
    digits = name.removeprefix(_PREFIX)
    return int(digits) if name.startswith(_PREFIX) and digits.isdecimal() and digits == str(int(digits)) else None


@lru_cache(maxsize=512)
def random_part(seed: int) -> Part:
    """Return the random part of this seed, named ``random_<seed>``.

    A base body, up to three bodies grown on it, and up to four holes; watertight, in one piece, 25 to 90 mm long.
    The collision pieces leave out the holes, which are narrow. Symmetries are detected, because chance makes some.
    """
    if seed < 0:
        raise ConfigError(f"seed must not be negative, got {seed}")
    rng = np.random.default_rng([_STREAM, seed])
    while True:
        solid, pieces = _attempt(rng)
        if is_sound(solid, pieces):
            break
    density = float(rng.choice([1050.0, 1200.0, 1400.0, 2700.0, 7800.0]))
    part = s.finish(f"{_PREFIX}{seed}", solid, pieces, Stock(density, random_look(rng)))
    lightest = min(density, HEAVIEST_KG / float(part.mesh.volume))
    return replace(part, symmetries=detect_symmetries(part.mesh), density_kg_m3=lightest)


def _attempt(rng: np.random.Generator) -> tuple[Manifold, list[Manifold]]:
    """Return a solid in millimetres, not always a valid one, and its convex pieces."""
    solid, pieces = _base(rng)
    for _ in range(rng.integers(0, 4)):
        # A body grows on the solid's skin: its centre lies on one of the solid's own vertices, drawn inward a bit.
        vertices = np.asarray(solid.to_mesh64().vert_properties)[:, :3]
        anchor = rng.uniform(0.6, 0.95) * vertices[rng.integers(len(vertices))]
        size = rng.uniform(0.35, 0.8)
        body = _turned(random_convex(rng), rng).scale((size, size, size)).translate(_point(anchor))
        solid, pieces = s.union(solid, body), [*pieces, body]
    holes = [_hole(solid, rng) for _ in range(rng.integers(0, 5))]
    solid = s.cut(solid, *holes)
    low, high = bounds(solid)
    factor = float(rng.uniform(SHORTEST_MM, LONGEST_MM) / (high - low).max())
    scale = (factor, factor, factor)
    return solid.scale(scale), [piece.scale(scale) for piece in pieces]


def is_sound(solid: Manifold, pieces: list[Manifold]) -> bool:
    """Return whether the solid is in one piece, nowhere too thin, and not mostly holes."""
    if solid.is_empty() or len(solid.decompose()) != 1 or len(pieces) > 12:
        return False
    # Neither slivers nor crumbs, which contacts cannot hold still.
    thinnest = min(float((high - low).min()) for low, high in map(bounds, pieces))
    return thinnest >= _THINNEST_MM and solid.volume() > max(_SMALLEST_MM3, 0.75 * s.union(*pieces).volume())


def _base(rng: np.random.Generator) -> tuple[Manifold, list[Manifold]]:
    """Return the body that the part starts from, about 40 long, and its convex pieces."""
    kind = rng.integers(6)
    a, b, c = rng.uniform(14.0, 40.0, size=3)
    wall = float(rng.uniform(5.0, 9.0))
    if kind == 0:  # An angle, a tee or a cross of two bars.
        x = float(rng.choice([-a, 0.0, a / 2]))
        bars = [
            s.box((-a, -c / 2, -wall / 2), (a, c / 2, wall / 2)),
            s.box((x - wall / 2, -c / 2, -wall / 2), (x + wall / 2, c / 2, b)),
        ]
        return s.union(*bars), bars
    if kind == 1:  # A channel with uneven legs.
        bars = [
            s.box((-a, -c / 2, 0), (a, c / 2, wall)),
            s.box((-a, -c / 2, 0), (wall - a, c / 2, b)),
            s.box((a - wall, -c / 2, 0), (a, c / 2, float(b * rng.uniform(0.5, 1.0)) + wall)),
        ]
        return s.union(*bars), bars
    if kind == 2:  # A tube, wide enough that its bore matters.
        radius = float(rng.uniform(12.0, 20.0))
        bore = radius * float(rng.uniform(0.45, 0.7))
        tube = s.cut(s.cylinder(radius, -a / 2, a / 2), s.cylinder(bore, -a, a))
        return tube, s.ring_pieces(s.round_outline(radius), bore, -a / 2, a / 2)
    if kind == 3:  # A stepped shaft.
        radii, lengths = rng.uniform(5.0, 14.0, size=3), rng.uniform(8.0, 28.0, size=3)
        ends = np.concatenate([[0.0], np.cumsum(lengths)]) - lengths.sum() / 2
        spans = [(float(r), float(z0), float(z1)) for r, z0, z1 in zip(radii, ends[:-1], ends[1:], strict=True)]
        return s.union(*[s.cylinder(*span) for span in spans]), [s.round_piece(*span) for span in spans]
    body = random_convex(rng)
    return body, [body]


def random_convex(rng: np.random.Generator) -> Manifold:
    """Return a convex body about the origin, 10 to 45 in each direction."""
    a, b, c = (float(x) for x in rng.uniform(10.0, 45.0, size=3))
    kind = rng.integers(6)
    if kind == 0:
        return s.box((-a / 2, -b / 2, -c / 2), (a / 2, b / 2, c / 2))
    if kind == 1:
        return s.cylinder(a / 2, -c / 2, c / 2)
    if kind == 2:
        return s.cylinder(a / 2, -c / 2, c / 2, top_radius=float(a / 2 * rng.uniform(0.3, 0.8)))
    if kind == 3:  # A prism on the hull of a few points round an ellipse.
        angles = np.sort(rng.uniform(0, 2 * np.pi, size=rng.integers(4, 8)))
        corners = np.stack([a / 2 * np.cos(angles), b / 2 * np.sin(angles)], axis=-1)
        return s.extrude(CrossSection.hull_points(corners), -c / 2, c / 2)
    if kind == 4:
        return s.extrude(s.slot(b / 2, a / 2), -c / 4, c / 4)
    # A block with slanted sides.
    top = (float(rng.uniform(0.4, 0.9)), float(rng.uniform(0.4, 1.0)))
    return CrossSection.square((a, b), True).extrude(c, 0, 0.0, top).translate((0.0, 0.0, -c / 2))


def _hole(solid: Manifold, rng: np.random.Generator) -> Manifold:
    """Return a narrow tool along some axis through the solid's inner region: a through or blind hole, or a notch."""
    low, high = bounds(solid)
    centre = 0.5 * (low + high) + rng.uniform(-0.35, 0.35, size=3) * (high - low)
    width = float(rng.uniform(0.05, 0.12) * (high - low).max())
    length = float((high - low).max())
    section = [
        s.circle(width, facets=24),
        s.rectangle((-width, -width / 2), (width, width / 2)),
        s.slot(1.5 * width, 0.7 * width),
        s.regular(6, 2 * width),
    ][rng.integers(4)]
    start = 0.0 if rng.random() < 0.4 else -length
    return _turned(s.extrude(section, start, length), rng).translate(_point(centre))


def _turned(solid: Manifold, rng: np.random.Generator) -> Manifold:
    """Return the solid turned by right angles, and one time in four by any angle about one axis too."""
    solid = solid.rotate(_point(90.0 * rng.integers(0, 4, size=3)))
    tilt = np.zeros(3)
    tilt[rng.integers(3)] = rng.uniform(10.0, 80.0)
    return solid.rotate(_point(tilt)) if rng.random() < 0.25 else solid


def random_look(rng: np.random.Generator) -> Material:
    """Return a colour and a gloss: half greys of metal, half colours."""
    saturation = rng.uniform(0.0, 0.12) if rng.random() < 0.5 else rng.uniform(0.3, 0.9)
    r, g, b = colorsys.hsv_to_rgb(rng.random(), saturation, rng.uniform(0.15, 0.95))
    return Material((r, g, b), specular=float(rng.uniform(0.1, 0.8)), shininess=float(rng.uniform(0.1, 0.8)))


def bounds(solid: Manifold) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Return the least and the greatest corner of a solid's box."""
    corners = np.array(solid.bounding_box())
    return corners[:3], corners[3:]


def _point(vector: Float[np.ndarray, "3"]) -> s.Point3:
    return (float(vector[0]), float(vector[1]), float(vector[2]))
