"""Parts of other families than the library's and the training's, with random dimensions in mm, as STL files.

``python -m tests.assets.foreign_parts FOLDER`` writes one of each family: the parts of `docs/results.md`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from manifold3d import CrossSection, Manifold

from simpick.assets import csg as s

FAMILIES: dict[str, Callable[[np.random.Generator], Manifold]] = {}
"""Functions that build a part of each family."""

_Builder = Callable[[np.random.Generator], Manifold]


def _family(build: _Builder) -> _Builder:
    FAMILIES[build.__name__] = build
    return build


def write_all(folder: Path, seed: int = 0) -> list[Path]:
    """Write one part of each family and return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for number, (name, build) in enumerate(FAMILIES.items()):
        solid = build(np.random.default_rng([seed, number]))
        files.append(folder / f"{name}.stl")
        s.to_trimesh(solid).export(files[-1])
    return files


@_family
def perforated_plate(rng: np.random.Generator) -> Manifold:
    a, b, t = rng.uniform(55, 75), rng.uniform(30, 45), rng.uniform(3, 5)
    centres = [(x, y, 0.0) for x in np.linspace(-a / 3, a / 3, 4) for y in (-b / 4, b / 4)]
    holes = [s.cylinder(3.0, -t, t).translate(centre) for centre in centres]
    return s.cut(s.box((-a / 2, -b / 2, -t / 2), (a / 2, b / 2, t / 2)), *holes)


@_family
def washer(rng: np.random.Generator) -> Manifold:
    r, t = rng.uniform(16, 24), rng.uniform(3, 5)
    return s.cut(s.cylinder(r, 0, t), s.cylinder(0.5 * r, -1, t + 1))


@_family
def thin_tube(rng: np.random.Generator) -> Manifold:
    r, length = rng.uniform(12, 18), rng.uniform(45, 70)
    return s.cut(s.cylinder(r, 0, length), s.cylinder(r - 1.2, -1, length + 1))


@_family
def cup(rng: np.random.Generator) -> Manifold:
    r, h = rng.uniform(16, 24), rng.uniform(30, 45)
    return s.cut(s.cylinder(0.8 * r, 0, h, top_radius=r), s.cylinder(0.8 * r - 1.5, 1.5, h + 1, top_radius=r - 1.5))


@_family
def rubber_foot(rng: np.random.Generator) -> Manifold:
    r, h = rng.uniform(10, 13), rng.uniform(9, 12)
    hole = s.union(s.cylinder(0.25 * r, -1, h + 1), s.cylinder(0.45 * r, h / 2, h + 1))
    return s.cut(s.cylinder(r, 0, h, top_radius=0.75 * r), hole)


@_family
def ball(rng: np.random.Generator) -> Manifold:
    return Manifold.sphere(rng.uniform(13, 19), 64)


@_family
def torus(rng: np.random.Generator) -> Manifold:
    ring, tube = rng.uniform(16, 22), rng.uniform(5, 7)
    return CrossSection.circle(tube, 24).translate((ring, 0)).revolve(64)


@_family
def hexagonal_rod(rng: np.random.Generator) -> Manifold:
    return s.extrude(s.regular(6, rng.uniform(10, 16)), 0, rng.uniform(50, 80))


@_family
def star_prism(rng: np.random.Generator) -> Manifold:
    outer, inner = rng.uniform(20, 26), rng.uniform(9, 13)
    angles = np.pi * np.arange(10) / 5
    radii = np.where(np.arange(10) % 2, inner, outer)
    return s.extrude(s.polygon(list(zip(radii * np.cos(angles), radii * np.sin(angles), strict=True))), 0, 10)


@_family
def spoked_wheel(rng: np.random.Generator) -> Manifold:
    r, t = rng.uniform(24, 30), rng.uniform(8, 12)
    rim = s.cut(s.cylinder(r, 0, t), s.cylinder(r - 5, -1, t + 1))
    spokes = s.ring_of(s.box((0, -2.5, 1.5), (r - 2, 2.5, t - 1.5)), 5)
    return s.cut(s.union(rim, s.cylinder(8, 0, t), *spokes), s.cylinder(4, -1, t + 1))


@_family
def heat_sink(rng: np.random.Generator) -> Manifold:
    a, h = rng.uniform(35, 45), rng.uniform(15, 25)
    fins = [s.box((x - 0.8, -a / 2, 0), (x + 0.8, a / 2, h)) for x in np.linspace(-a / 2 + 0.8, a / 2 - 0.8, 7)]
    return s.union(s.box((-a / 2, -a / 2, -4), (a / 2, a / 2, 0.1)), *fins)


@_family
def sheet_angle(rng: np.random.Generator) -> Manifold:
    a, b, t = rng.uniform(30, 45), rng.uniform(25, 40), 1.5
    return s.union(s.box((0, 0, 0), (a, b, t)), s.box((0, 0, 0), (t, b, 0.7 * a)))


@_family
def bottle_cap(rng: np.random.Generator) -> Manifold:
    r, h = rng.uniform(14, 18), rng.uniform(12, 18)
    ribs = s.ring_of(s.box((r - 0.5, -0.6, 0), (r + 0.8, 0.6, h)), 24)
    return s.cut(s.union(s.cylinder(r, 0, h), *ribs), s.cylinder(r - 1.8, 1.8, h + 1))


@_family
def dumbbell(rng: np.random.Generator) -> Manifold:
    r, gap = rng.uniform(9, 12), rng.uniform(35, 50)
    balls = [Manifold.sphere(r, 48).translate((0, 0, z)) for z in (-gap / 2, gap / 2)]
    return s.union(*balls, s.cylinder(4, -gap / 2, gap / 2))


@_family
def pyramid(rng: np.random.Generator) -> Manifold:
    a, h = rng.uniform(35, 50), rng.uniform(25, 40)
    return CrossSection.square((a, a), True).extrude(h, 0, 0.0, (0.15, 0.15))


@_family
def pebble(rng: np.random.Generator) -> Manifold:
    points = rng.normal(size=(24, 3))
    return Manifold.hull_points(points / np.linalg.norm(points, axis=1, keepdims=True) * [26, 18, 12])


@_family
def cam_disc(rng: np.random.Generator) -> Manifold:
    outline = CrossSection.batch_hull([s.circle(16), s.circle(7, (rng.uniform(16, 22), 0))])
    return s.cut(s.extrude(outline, 0, 9), s.cylinder(6, -1, 10))


@_family
def chain_link(rng: np.random.Generator) -> Manifold:
    length, r = rng.uniform(20, 30), rng.uniform(10, 13)
    return s.extrude(s.slot(length, r) - s.slot(length, r - 5), 0, 8)


@_family
def corrugated_sheet(rng: np.random.Generator) -> Manifold:
    x = np.linspace(-30, 30, 61)
    y = rng.uniform(4, 6) * np.sin(x / 4)
    upper, lower = list(zip(x, y + 1.0, strict=True)), list(zip(x, y - 1.0, strict=True))
    return s.extrude(s.polygon(lower + upper[::-1]), 0, 40)


@_family
def u_rail(rng: np.random.Generator) -> Manifold:
    a, b = rng.uniform(18, 26), rng.uniform(50, 75)
    return s.cut(s.box((-a / 2, -b / 2, 0), (a / 2, b / 2, a)), s.box((2 - a / 2, -b, 2), (a / 2 - 2, b, a + 1)))


if __name__ == "__main__":
    for file in write_all(Path(sys.argv[1])):
        print(file)
