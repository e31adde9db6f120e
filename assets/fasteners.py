"""Library parts that join: bolts, nuts, pins and screws. Dimensions in millimetres."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from simpick.assets import solids as s
from simpick.assets.part import Part
from simpick.assets.stock import STEEL, ZINC_YELLOW
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
    # A disc of the hexagon's area, because ring_pieces draws its polygons by equal area.
    outer = 32.0 * np.sqrt(np.sqrt(3.0) / (2 * np.pi))
    pieces = s.ring_pieces(9.0, outer, -8.0, 8.0, segments=6, outer_facets=1)
    return s.finish("hex_nut", s.cut(body, bore), pieces, ZINC_YELLOW, SymmetryGroup.cyclic(6, flips=True))
