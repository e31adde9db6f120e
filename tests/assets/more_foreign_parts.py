"""Twelve more parts of other families, made after the sampling of grasps and not used to change it.

``python -m tests.assets.more_foreign_parts FOLDER`` writes them; `docs/results.md` reports how they are picked.
"""

from __future__ import annotations

import sys
from itertools import pairwise, product
from pathlib import Path

import numpy as np
from manifold3d import Manifold, OpType

from simpick.assets import csg as s


def knob() -> Manifold:
    t = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    r = 18 + 2.5 * np.cos(5 * t)
    head = s.extrude(s.polygon(list(zip(r * np.cos(t), r * np.sin(t), strict=True))), 0, 12)
    return s.cut(s.union(head, s.cylinder(9, -10, 0.1)), s.cylinder(3.5, -11, 6))


def bellows() -> Manifold:
    folds = [point for k in range(6) for point in ((10, 6 * k), (15, 6 * k + 3))]
    return s.revolve([(0, 0), *folds, (10, 36), (0, 36)])


def hinge_knuckle() -> Manifold:
    def along_y(length: float, radius: float, y: float, facets: int) -> Manifold:
        return Manifold.cylinder(length, radius, radius, facets).rotate((-90, 0, 0)).translate((0, y, 5))

    knuckles = [along_y(8, 5, -20 + 16 * k, 32) for k in range(3)]
    return s.cut(s.union(s.box((0, -20, 0), (34, 20, 3)), *knuckles), along_y(60, 2.2, -30, 24))


def spring() -> Manifold:
    turns = [(12 * np.cos(a), 12 * np.sin(a), 7 * k / 36) for k in range(145) for a in [2 * np.pi * k / 36]]
    balls = [Manifold.sphere(2.2, 10).translate(centre) for centre in turns]
    return Manifold.batch_boolean([Manifold.batch_hull(pair) for pair in pairwise(balls)], OpType.Add)


def cross_spider() -> Manifold:
    arms = [Manifold.cylinder(56, 5.5, 5.5, 32, True).rotate(turn) for turn in ((0, 90, 0), (90, 0, 0))]
    return s.union(Manifold.sphere(10, 40), *arms)


def pulley() -> Manifold:
    body = s.revolve([(0, 0), (22, 0), (22, 3), (15, 8), (22, 13), (22, 16), (0, 16)])
    return s.cut(body, s.cylinder(5, -1, 17), s.box((-1.5, 0, -1), (1.5, 7, 17)))


def clevis() -> Manifold:
    body = s.union(s.box((-20, -11, -11), (14, 11, 11)), s.cylinder(7, 0, 38).rotate((0, 90, 0)))
    pin = Manifold.cylinder(40, 4, 4, 32, True).rotate((90, 0, 0)).translate((-12, 0, 0))
    return s.cut(body, s.box((-30, -5.5, -20), (-2, 5.5, 20)), pin)


def honeycomb() -> Manifold:
    section = s.regular(6, 44)
    for i, j in product(range(-2, 3), repeat=2):
        x, y = 10 * (i + 0.5 * (j % 2)), 8.66 * j
        if np.hypot(x, y) < 15.5:
            section = section - s.regular(6, 7.6).translate((x, y))
    return s.extrude(section, 0, 9)


def wedge_lock() -> Manifold:
    section = s.polygon([(-16, 0), (16, 0), (9, 16), (-9, 16)])
    return s.cut(s.extrude(section, 0, 48).rotate((6, 0, 0)), s.cylinder(3, -20, 80).translate((0, 6, 0)))


def antenna_mast() -> Manifold:
    tip = Manifold.sphere(3.5, 24).translate((0, 0, 85))
    return s.union(s.box((-9, -9, 0), (9, 9, 12)), s.cylinder(2, 10, 85), tip)


def cage() -> Manifold:
    rods = []
    for axis, u, v in product(range(3), (0, 34), (0, 34)):
        size, corner = np.full(3, 3.0), np.insert([u, v], axis, 0) - 1.5
        size[axis] = 37.0
        rods.append(Manifold.cube(size.tolist()).translate(corner.tolist()))
    return s.union(*rods)


def handle() -> Manifold:
    posts = s.box((-35, -5, 0), (-27, 5, 24)), s.box((27, -5, 0), (35, 5, 24))
    return s.union(*posts, s.cylinder(5, -35, 35).rotate((0, 90, 0)).translate((0, 0, 24)))


PARTS = (
    knob, bellows, hinge_knuckle, spring, cross_spider, pulley,
    clevis, honeycomb, wedge_lock, antenna_mast, cage, handle,
)  # fmt: skip

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for build in PARTS:
        s.to_trimesh(build()).export(folder / f"{build.__name__}.stl")
        print(folder / f"{build.__name__}.stl")
