"""Library parts that carry fluids: tees, elbows, flanges and hose ends. Dimensions in millimetres.

Bores under 12 mm are closed in the collision pieces: nothing in the library is thin enough to enter them.
"""

from __future__ import annotations

import numpy as np
from manifold3d import CrossSection, Manifold

from simpick.assets import csg as s
from simpick.assets.materials import ALUMINIUM, BRASS, CAST_IRON, COPPER, GREY_PVC
from simpick.assets.part import Part
from simpick.geometry.symmetry import SymmetryGroup
from simpick.geometry.transforms import so3_exp, transform


def pipe_tee() -> Part:
    """Pipe tee with collars: a run of 56 along x and a branch along z, bore 15."""
    run = s.along_x(s.union(s.cylinder(9.8, -28, 28), s.cylinder(12.0, -28, -19), s.cylinder(12.0, 19, 28)))
    branch = s.union(s.cylinder(9.8, 0, 31), s.cylinder(12.0, 22, 31))
    bores = (s.along_x(s.cylinder(7.5, -31, 31)), s.cylinder(7.5, 0, 33))
    solid = s.cut(s.union(run, branch), *bores)
    walls = [s.along_x(w) for w in s.ring_pieces(s.round_outline(10.6), 7.5, -28, 28, segments=4, start_deg=-45.0)]
    # The branch opens into the run's upper wall, which is entirely above the axis.
    upper = next(wall for wall in walls if wall.bounding_box()[2] > 0)
    walls.remove(upper)
    walls += [upper.trim_by_plane((1.0, 0.0, 0.0), 7.5), upper.trim_by_plane((-1.0, 0.0, 0.0), 7.5)]
    walls += s.ring_pieces(s.round_outline(10.7), 7.5, 7.0, 31.0, segments=4, start_deg=-45.0)
    return s.finish("pipe_tee", solid, walls, BRASS, SymmetryGroup.cyclic(2))


_BEND = 20.0
"""Bend radius of the elbow, from the turning axis to the bore's centre line."""


def _bend(radius: float, start_deg: float, sweep_deg: float, facets: int) -> Manifold:
    """Return a piece of a torus about z, turned from the x axis."""
    section = CrossSection.circle(radius, facets).translate((_BEND, 0.0))
    turned = Manifold.revolve(section, 36, sweep_deg)
    return turned.rotate((0.0, 0.0, start_deg))


def pipe_elbow() -> Part:
    """Solder elbow of 90 degrees with equal ends, bore 11: a half turn about the bisector swaps them."""
    half_turn = transform(so3_exp(np.pi * np.array([1.0, 1.0, 0.0]) / np.sqrt(2)))

    def both_ends(solid: Manifold) -> list[Manifold]:
        return [solid, solid.transform(half_turn[:3])]

    def along_minus_y(solid: Manifold) -> Manifold:
        return solid.rotate((90.0, 0.0, 0.0)).translate((_BEND, 0.0, 0.0))

    socket = s.revolve([(0, -2), (8.5, -2), (10.5, 0), (10.5, 13), (9.5, 14), (0, 14)])
    outside = s.union(_bend(8.5, 0.0, 90.0, 24), *both_ends(along_minus_y(socket)))
    bores = [_bend(5.5, 0.0, 90.0, 24), *both_ends(along_minus_y(s.cylinder(5.5, -0.1, 15.0, facets=24)))]
    mouths = both_ends(along_minus_y(s.cylinder(7.0, 5.0, 15.0)))
    pieces = [_bend(8.6, 30.0 * k, 30.0, 12) for k in range(3)]
    pieces += both_ends(along_minus_y(s.round_piece(10.5, 0.0, 14.0)))
    symmetry = SymmetryGroup(half_turn[None])
    return s.finish("pipe_elbow", s.cut(outside, *bores, *mouths), pieces, COPPER, symmetry)


def hub_flange() -> Part:
    """Round flange of 62 with a hub, four bolt holes and a bore of 11."""
    body = s.revolve([(0, 0), (30.0, 0), (31.0, 1), (31.0, 8), (15.0, 8), (13.0, 10), (12.0, 24), (0, 24)])
    holes = s.ring_of(s.cylinder(3.5, -1.0, 9.0, facets=24).translate((23.0, 0.0, 0.0)), 4)
    solid = s.cut(body, s.cylinder(5.5, -1.0, 25.0), *holes)
    pieces = [s.round_piece(31.0, 0.0, 8.0), s.round_piece(13.2, 8.0, 24.0, top_radius=12.0)]
    return s.finish("hub_flange", solid, pieces, ALUMINIUM, SymmetryGroup.cyclic(4))


def tri_flange() -> Part:
    """Three-bolt exhaust flange with a collar on one side, bore 24: three-fold about an axis beside its box centre."""
    lobes = [s.circle(8.5, (24.0, 0.0)).rotate(120.0 * k) for k in range(3)]
    outline = CrossSection.batch_hull([*lobes, s.circle(18.5)])
    plate = s.extrude(outline, 0.0, 7.0)
    collar = s.cylinder(16.0, 7.0, 13.0)
    holes = s.ring_of(s.cylinder(4.0, -1.0, 8.0, facets=24).translate((24.0, 0.0, 0.0)), 3)
    solid = s.cut(s.union(plate, collar), s.cylinder(12.0, -1.0, 14.0), *holes)
    rough = CrossSection.batch_hull([s.circle(8.6, (24.0, 0.0), facets=12).rotate(120.0 * k) for k in range(3)])
    pieces = s.ring_pieces(rough, 12.0, 0.0, 7.0, segments=6)
    pieces += s.ring_pieces(s.round_outline(16.0), 12.0, 7.0, 13.0, segments=6)
    return s.finish("tri_flange", solid, pieces, CAST_IRON, SymmetryGroup.cyclic(3))


def hose_barb() -> Part:
    """Hose tail: barbs, a hexagon and a plain spigot, bore 8."""
    barbs = [(0.0, 5.0), (6.0, 5.0)]
    for k in range(4):
        z = 7.0 + 6.5 * k
        barbs += [(6.0, z), (7.8, z + 0.6), (6.2, z + 6.5)]
    tail = s.revolve([*barbs, (6.0, 34.0), (0.0, 34.0)])
    hexagon = s.extrude(s.regular(6, 22.0), -3.0, 6.0)
    spigot = s.revolve([(0, -20), (7.6, -20), (8.6, -19), (8.6, -2), (0, -2)])
    solid = s.cut(s.union(tail, hexagon, spigot), s.cylinder(4.0, -21.0, 35.0))
    pieces = [s.extrude(s.regular(6, 22.0), -3.0, 6.0), s.round_piece(7.0, 6.0, 34.0), s.round_piece(8.6, -20.0, -3.0)]
    return s.finish("hose_barb", solid, pieces, GREY_PVC, SymmetryGroup.cyclic(6))
