"""Library parts that join: bolts, nuts, pins and screws. Dimensions in millimetres."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from simpick.assets import csg as s
from simpick.assets.materials import ALUMINIUM, BLACK_STEEL, BRASS, STEEL, ZINC_YELLOW
from simpick.assets.part import Part
from simpick.geometry.symmetry import SymmetryGroup


def _thread(radius: float, z0: float, z1: float, pitch: float) -> Manifold:
    """Return a rod with ring grooves for a thread; rings, not a helix, because a helix has no rotation symmetry."""
    depth = 0.45 * pitch
    count = round((z1 - z0) / pitch)
    step = (z1 - z0) / count
    profile = [(0.0, z0), (radius - depth, z0)]
    for k in range(count):
        profile += [(radius, z0 + (k + 0.5) * step), (radius - depth, z0 + (k + 1) * step)]
    return s.revolve([*profile, (0.0, z1)])


def _chamfered_hexagon(across_flats: float, z0: float, z1: float, *, both_ends: bool) -> Manifold:
    """Return a hexagonal prism whose corners are turned off at 30 degrees, at z1 and perhaps at z0."""
    flat, corner = 0.48 * across_flats, 0.5 * across_flats / np.cos(np.pi / 6) + 0.5
    drop = (corner - flat) * np.tan(np.pi / 6)
    low = [(0.0, z0), (flat, z0), (corner, z0 + drop)] if both_ends else [(0.0, z0), (corner, z0)]
    return s.extrude(s.regular(6, across_flats), z0, z1) ^ s.revolve([*low, (corner, z1 - drop), (flat, z1), (0.0, z1)])


def hex_bolt() -> Part:
    """Hexagon head bolt, 14 x 46, partly threaded."""
    head = _chamfered_hexagon(22.0, 0.0, 9.0, both_ends=False)
    shank = s.union(s.cylinder(7.0, -20.0, 0.5), _thread(7.0, -46.0, -20.0, 2.6))
    pieces = [s.extrude(s.regular(6, 22.0), 0.0, 8.6), s.round_piece(6.8, -46.0, 0.0)]
    return s.finish("hex_bolt", s.union(head, shank), pieces, STEEL, SymmetryGroup.cyclic(6))


def hex_nut() -> Part:
    """Hexagon nut, 32 across flats, bore 18."""
    body = _chamfered_hexagon(32.0, -8.0, 8.0, both_ends=True)
    bore = s.revolve([(0, -9), (11, -9), (11, -8), (9, -6), (9, 6), (11, 8), (11, 9), (0, 9)])
    pieces = s.ring_pieces(s.regular(6, 32.0), 9.0, -8.0, 8.0)
    return s.finish("hex_nut", s.cut(body, bore), pieces, ZINC_YELLOW, SymmetryGroup.cyclic(6, flips=True))


def socket_screw() -> Part:
    """Socket head cap screw, 12 x 40: a round part that only the hexagon in its head turns into a discrete one."""
    head = s.revolve([(0, 0), (9.0, 0), (9.0, 10.8), (7.8, 12.0), (0, 12.0)])
    socket = s.extrude(s.regular(6, 10.0), 5.0, 13.0)
    shank = s.union(s.cylinder(6.0, -12.0, 0.5), _thread(6.0, -40.0, -12.0, 2.3))
    pieces = [s.round_piece(9.0, 0.0, 12.0), s.round_piece(5.8, -40.0, 0.0)]
    return s.finish("socket_screw", s.cut(s.union(head, shank), socket), pieces, BLACK_STEEL, SymmetryGroup.cyclic(6))


def wing_nut() -> Part:
    """Wing nut, 56 over its wings."""
    hub = s.revolve([(0, 0), (11.0, 0), (11.0, 5.0), (8.5, 16.0), (0, 16.0)])
    outline = s.polygon([(0, 2), (9, 2), (15, 10), (28, 17), (28, 26), (21, 28), (9, 13), (0, 13)], round_corners=2.0)
    wing = s.upright(s.extrude(outline, -2.5, 2.5))
    solid = s.cut(s.union(hub, wing, wing.rotate((0.0, 0.0, 180.0))), s.cylinder(5.0, -1.0, 17.0))
    lower = s.extrude(s.polygon([(8, 3), (10, 2.5), (15.5, 10.5), (19, 24.5), (8, 12)]), -2.5, 2.5)
    upper = s.extrude(s.polygon([(15, 10.5), (27.5, 17.5), (27.7, 25.5), (21, 27.6), (18, 23.6)]), -2.5, 2.5)
    wings = [piece.rotate((90.0, 0.0, turn)) for piece in (lower, upper) for turn in (0.0, 180.0)]
    pieces = [s.round_piece(11.0, 0.0, 16.0, top_radius=8.5), *wings]
    return s.finish("wing_nut", solid, pieces, BRASS, SymmetryGroup.cyclic(2))


def eye_bolt() -> Part:
    """Eye bolt: a ring of 20 bore on a collar and a threaded shank."""
    ring = s.upright(s.revolve([(10 + 4.5 + 4.5 * c, 4.5 * n) for c, n in _unit_circle(16)])).translate((0, 0, 20.0))
    collar = s.revolve([(0, 0), (9.0, 0), (9.0, 3.0), (6.0, 7.5), (0, 7.5)])
    shank = _thread(6.0, -28.0, 0.5, 2.3)
    segments = s.ring_pieces(s.round_outline(18.6), 10.4, -3.9, 3.9, segments=8)
    pieces = [s.upright(piece).translate((0, 0, 20.0)) for piece in segments]
    pieces += [s.round_piece(9.0, 0.0, 7.5, top_radius=6.0), s.round_piece(5.8, -28.0, 0.0)]
    return s.finish("eye_bolt", s.union(ring, collar, shank), pieces, STEEL, SymmetryGroup.cyclic(2))


def clevis_pin() -> Part:
    """Headed pin, 14 x 52, with a cross hole for a cotter at its end."""
    head = s.revolve([(0, 0), (11.0, 0), (11.0, 4.0), (10.0, 5.0), (0, 5.0)])
    shank = s.revolve([(0, -52), (6.0, -52), (7.0, -51), (7.0, 0.5), (0, 0.5)])
    hole = s.along_x(s.cylinder(2.5, -10.0, 10.0, facets=24)).translate((0, 0, -45.0))
    pieces = [s.round_piece(11.0, 0.0, 5.0), s.round_piece(7.0, -52.0, 0.0)]
    return s.finish("clevis_pin", s.cut(s.union(head, shank), hole), pieces, ALUMINIUM, SymmetryGroup.cyclic(2))


def bushing() -> Part:
    """Plain bearing bush, bore 20: a full revolution with two equal ends."""
    profile = [(10, -14), (10, -15), (14.2, -15), (15, -14.2), (15, 14.2), (14.2, 15), (10, 15)]
    pieces = s.ring_pieces(s.round_outline(15.0), 10.0, -15.0, 15.0, segments=8)
    return s.finish("bushing", s.revolve(profile), pieces, BRASS, SymmetryGroup.revolution(flip=True))


def _unit_circle(count: int) -> list[tuple[float, float]]:
    angles = 2 * np.pi * np.arange(count) / count
    return [(float(np.cos(a)), float(np.sin(a))) for a in angles]
