"""Library parts that hold: brackets, forks, hinges, hooks and bearing blocks. Dimensions in millimetres."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from manifold3d import Manifold

from simpick.assets import csg as s
from simpick.assets.materials import BLACK_STEEL, GREEN_PAINT, ORANGE_PAINT, STEEL, ZINC_YELLOW
from simpick.assets.part import Part
from simpick.geometry.symmetry import SymmetryGroup


def l_bracket() -> Part:
    """Angle bracket with a gusset beside its middle; legs of 56 and 40."""

    def leg(length: float) -> Manifold:
        outline = s.rounded(s.rectangle((0, -16), (length, 16)), 5.0) + s.rectangle((0, -16), (20, 16))
        return s.extrude(outline, 0.0, 5.0)

    def raised(solid: Manifold) -> Manifold:
        return solid.rotate((0.0, -90.0, 0.0)).translate((5.0, 0.0, 0.0))

    rib = s.upright(s.extrude(s.polygon([(3, 3), (30, 3), (3, 26)]), -2.5, 2.5)).translate((0.0, 5.0, 0.0))
    hole = s.cylinder(3.5, -1.0, 6.0, facets=24)
    slot = raised(s.extrude(s.slot(9.0, 3.2), -1.0, 6.0).translate((26.0, -7.0, 0.0)))
    solid = s.union(leg(56.0), raised(leg(40.0)), rib)
    solid = s.cut(solid, hole.translate((38.0, -8.0, 0.0)), hole.translate((48.0, 8.0, 0.0)), slot)
    pieces = [s.box((0, -16, 0), (56, 16, 5)), s.box((0, -16, 5), (5, 16, 40)), rib]
    return s.finish("l_bracket", solid, pieces, ZINC_YELLOW)


def z_bracket() -> Part:
    """Z-shaped bracket of 4 mm sheet: a half turn about its width maps it onto itself."""
    outline = [(-2, -16), (32, -16), (32, -12), (2, -12), (2, 16), (-32, 16), (-32, 12), (-2, 12)]
    sheet = s.upright(s.extrude(s.polygon(outline, round_corners=1.2), -14.0, 14.0))
    holes = [s.cylinder(4.0, -20.0, 20.0, facets=24).translate((x, 0.0, 0.0)) for x in (19.0, -19.0)]
    pieces = [
        s.box((-2, -14, -16), (32, 14, -12)),
        s.box((-32, -14, 12), (2, 14, 16)),
        s.box((-2, -14, -12), (2, 14, 12)),
    ]
    return s.finish("z_bracket", s.cut(sheet, *holes), pieces, STEEL, SymmetryGroup.cyclic(2, (0.0, 1.0, 0.0)))


def clevis_fork() -> Part:
    """Fork head: two ears with a cross hole of 10, and a rod."""
    outline = s.rectangle((-10, 0), (10, 24)) + s.circle(10.0, (0.0, 24.0))
    body = s.upright(s.extrude(outline, -12.0, 12.0))
    gap = s.union(s.box((-11, -6.5, 14.5), (11, 6.5, 40)), s.along_x(s.cylinder(6.5, -11, 11)).translate((0, 0, 14.5)))
    hole = s.upright(s.cylinder(5.0, -13.0, 13.0)).translate((0.0, 0.0, 24.0))
    rod = s.revolve([(0, -26), (5.0, -26), (6.0, -25), (6.0, 1), (0, 1)])
    ear = s.upright(s.extrude(outline ^ s.rectangle((-10, 8.5), (10, 40)), 6.5, 12.0))
    pieces = [s.box((-10, -12, 0), (10, 12, 8.5)), ear, ear.rotate((0, 0, 180.0)), s.round_piece(6.0, -26, 0)]
    return s.finish("clevis_fork", s.cut(s.union(body, rod), gap, hole), pieces, STEEL, SymmetryGroup.cyclic(2))


def pillow_block() -> Part:
    """Bearing block with a bore of 19 and a grease boss to one side."""
    axis = (0.0, 0.0, 24.0)
    base = s.extrude(s.rounded(s.rectangle((-36, -11), (36, 11)), 4.0), 0.0, 7.0)
    outline = s.polygon([(-24, 5), (24, 5), (18, 24), (-18, 24)]) + s.circle(18.0, (0.0, 24.0))
    housing = s.upright(s.extrude(outline, -9.0, 9.0))
    bore = s.upright(s.cylinder(9.5, -10.0, 10.0)).translate(axis)
    boss = s.cylinder(3.5, 15.0, 22.0, facets=24).rotate((0.0, 40.0, 0.0)).translate(axis)
    slots = [s.extrude(s.slot(6.0, 3.0), -1.0, 8.0).translate((x, 0.0, 0.0)) for x in (-29.0, 29.0)]
    solid = s.cut(s.union(base, housing, boss), bore, *slots)
    pieces = [s.upright(p).translate(axis) for p in s.ring_pieces(s.round_outline(18.0), 9.5, -9.0, 9.0)]
    foot = s.upright(s.extrude(s.polygon([(5.0, 7), (23.4, 7), (18.3, 23)]), -9.0, 9.0))
    pieces += [s.box((-36, -11, 0), (36, 11, 7)), foot, foot.rotate((0.0, 0.0, 180.0)), boss]
    return s.finish("pillow_block", solid, pieces, GREEN_PAINT)


def hinge_leaf() -> Part:
    """One leaf of a hinge: a plate with three countersunk holes and two knuckles."""
    outline = s.rounded(s.rectangle((-3, -26), (38, 26)), 5.0) + s.rectangle((-3, -26), (12, 26))
    knuckles = [s.upright(s.cylinder(6.0, low, low + 15.0)).translate((-3.0, 0.0, 6.0)) for low in (-26.0, -1.0)]
    pin = s.upright(s.cylinder(3.0, -30.0, 30.0, facets=24)).translate((-3.0, 0.0, 6.0))
    gaps = [s.box((-10, y0, -1), (4, y1, 13)) for y0, y1 in ((-27.0, -14.3), (1.3, 10.7))]
    sink = s.union(s.cylinder(2.8, -1.0, 5.0, facets=24), s.cylinder(2.8, 2.0, 4.6, facets=24, top_radius=5.4))
    holes = [sink.translate((x, y, 0.0)) for x, y in ((14.0, -17.0), (14.0, 17.0), (29.0, 0.0))]
    solid = s.cut(s.union(s.cut(s.extrude(outline, 0.0, 4.5), *gaps), *knuckles), pin, *holes)
    pieces = [s.box((4, -26, 0), (38, 26, 4.5))]
    for low in (-26.0, -1.0):
        barrel = s.upright(s.round_piece(6.0, low, low + 15.0, facets=12)).translate((-3.0, 0.0, 6.0))
        pieces += [barrel, s.box((-3, -low - 15.0, 0), (4, -low, 4.5))]
    return s.finish("hinge_leaf", solid, pieces, BLACK_STEEL)


def crane_hook() -> Part:
    """Forged hook with an eye of 11 bore."""

    def disc(x: float, z: float, radius: float) -> Manifold:
        half = 5.5
        rim = [
            (0, -half),
            (radius - 1.5, -half),
            (radius, 1.5 - half),
            (radius, half - 1.5),
            (radius - 1.5, half),
            (0, half),
        ]
        return s.upright(s.revolve(rim, facets=24)).translate((x, 0.0, z))

    # The throat: an arc about (0, -32) from the back of the shank round to the tip, thickest at the bottom.
    angles = np.radians(np.linspace(120.0, 375.0, 13))
    thickness = np.interp(angles, np.radians([120.0, 270.0, 375.0]), [6.0, 7.5, 4.0])
    arc = [disc(15.0 * np.cos(a), -32.0 + 15.0 * np.sin(a), r) for a, r in zip(angles, thickness, strict=True)]
    eye = disc(0.0, 0.0, 11.0)
    shank = s.hull(disc(0.0, -6.0, 6.0), arc[0])
    solid = s.union(eye, shank, *[s.hull(a, b) for a, b in pairwise(arc)])
    solid = s.cut(solid, s.upright(s.cylinder(5.5, -6.0, 6.0)))
    pieces = [eye, shank, *[s.hull(arc[k], arc[k + 2]) for k in range(0, 12, 2)]]
    return s.finish("crane_hook", solid, pieces, ORANGE_PAINT)
