"""Library parts that move: rods, gears, shafts, cranks and pulleys. Dimensions in millimetres."""

from __future__ import annotations

import numpy as np
from manifold3d import CrossSection

from simpick.assets import csg as s
from simpick.assets.materials import ALUMINIUM, BLUE_ANODISED, BRONZE, STEEL, WHITE_POM
from simpick.assets.part import Part
from simpick.geometry.symmetry import SymmetryGroup


def connecting_rod() -> Part:
    """Connecting rod, 58 between centres: big end with bolted cap, I-section, small end."""
    big, small = (0.0, 0.0), (58.0, 0.0)
    beam = s.polygon([(0, -11), (58, -7), (58, 7), (0, 11)])
    flat = s.extrude(s.circle(16.5, big) + s.circle(10.5, small), -7.0, 7.0)
    web = s.extrude(beam, -5.0, 5.0)
    corners = [(22, -3.4), (42.5, -1.8), (42.5, 1.8), (22, 3.4)]
    recess = CrossSection.batch_hull([s.circle(2.0, corner, facets=24) for corner in corners])
    bolts = [s.along_x(s.cylinder(3.6, -9.0, 9.0, facets=24)).translate((0.0, y, 0.0)) for y in (-16.5, 16.5)]
    solid = s.union(flat, web, *bolts)
    tools = [
        s.cylinder(11.0, -8.0, 8.0),
        s.cylinder(5.5, -8.0, 8.0).translate((58.0, 0.0, 0.0)),
        s.extrude(recess, 2.5, 8.0),
        s.extrude(recess, -8.0, -2.5),
    ]
    pieces = [*s.ring_pieces(s.round_outline(16.5), 11.0, -7.0, 7.0), *bolts]
    pieces += [s.round_piece(10.5, -7.0, 7.0).translate((58.0, 0.0, 0.0))]
    pieces += [s.extrude(s.polygon([(13, -10.2), (54, -7.2), (54, 7.2), (13, 10.2)]), -4.6, 4.6)]
    symmetry = SymmetryGroup.cyclic(2, (1.0, 0.0, 0.0))
    return s.finish("connecting_rod", s.cut(solid, *tools), pieces, ALUMINIUM, symmetry)


def spur_gear() -> Part:
    """Spur gear of 16 teeth, module 2.5, with a hub on one side; bore 9."""
    teeth, module = 16, 2.5
    pitch, root, tip = 0.5 * module * teeth, 0.5 * module * (teeth - 2.5), 0.5 * module * (teeth + 2)
    # A tooth is an involute in three straight flanks: half its angle at root, pitch circle and tip.
    flank = [(root - 1.0, 0.155), (root, 0.145), (pitch, 0.5 * np.pi / teeth), (tip, 0.045)]
    side = [(r * np.cos(a), r * np.sin(a)) for r, a in flank]
    tooth = s.polygon([(x, -y) for x, y in side] + side[::-1])
    outline = s.circle(root) + CrossSection.compose([tooth.rotate(360.0 * k / teeth) for k in range(teeth)])
    solid = s.union(s.extrude(outline, -1.0, 9.0), s.cylinder(10.0, 9.0, 17.0))
    ring_groove = s.revolve([(10.0, 7.0), (13.5, 7.0), (14.0, 9.5), (10.0, 9.5)])
    lower_groove = s.revolve([(8.0, -1.5), (14.0, -1.5), (13.5, 1.0), (8.0, 1.0)])
    solid = s.cut(solid, s.cylinder(4.5, -2.0, 18.0), ring_groove, lower_groove)
    pieces = [s.extrude(outline.hull(), -1.0, 9.0), s.round_piece(10.0, 9.0, 17.0)]
    return s.finish("spur_gear", solid, pieces, BRONZE, SymmetryGroup.cyclic(teeth))


def keyed_shaft() -> Part:
    """Stepped shaft of 78 with a keyway in its middle step and a flat at its thin end."""
    body = s.revolve(
        [(0, -39), (6.0, -39), (7.0, -38), (7.0, -14), (9.5, -14), (9.5, 16), (6.0, 16), (6.0, 38), (5.0, 39), (0, 39)]
    )
    key = s.extrude(s.slot(14.0, 3.0), 5.5, 11.0).rotate((0.0, 90.0, 0.0)).translate((0.0, 0.0, 1.0))
    flat = s.box((-7.0, -7.0, 26.0), (7.0, -3.6, 40.0))
    pieces = [s.round_piece(7.0, -39.0, -14.0), s.round_piece(9.5, -14.0, 16.0), s.round_piece(6.0, 16.0, 39.0)]
    return s.finish("keyed_shaft", s.cut(body, key, flat), pieces, STEEL)


def crank_arm() -> Part:
    """Crank: a clamping boss, a tapered arm and a raised pin at the other end."""
    arm_outline = CrossSection.batch_hull([s.circle(10.0, (-24.0, 0.0)), s.circle(7.5, (24.0, 0.0))])
    arm = s.extrude(arm_outline, 0.0, 9.0)
    boss = s.cylinder(12.0, 0.0, 20.0).translate((-24.0, 0.0, 0.0))
    pin = s.revolve([(0, -6), (8.0, -6), (8.0, 9), (5.0, 9), (5.0, 23), (4.0, 24), (0, 24)]).translate((24.0, 0.0, 0.0))
    bore = s.union(s.cylinder(5.5, -1, 21), s.box((-1.6, 0.0, -1.0), (1.6, 7.6, 21.0))).translate((-24.0, 0.0, 0.0))
    pieces = [
        s.extrude(
            CrossSection.batch_hull(
                [s.round_outline(10.0).translate((-24.0, 0.0)), s.round_outline(7.5).translate((24.0, 0.0))]
            ),
            0.0,
            9.0,
        ),
        s.round_piece(12.0, 0.0, 20.0).translate((-24.0, 0.0, 0.0)),
        s.round_piece(8.0, -6.0, 9.0).translate((24.0, 0.0, 0.0)),
        s.round_piece(5.0, 9.0, 24.0).translate((24.0, 0.0, 0.0)),
    ]
    return s.finish("crank_arm", s.cut(s.union(arm, boss, pin), bore), pieces, BLUE_ANODISED)


def vee_pulley() -> Part:
    """V-belt pulley of 54 with a hub on one side, bore 10: a revolution whose ends differ."""
    profile = [
        (5, -8),
        (27, -8),
        (27, -6.5),
        (20, -1.5),
        (20, 1.5),
        (27, 6.5),
        (27, 8),
        (11, 8),
        (11, 18),
        (10, 19),
        (5, 19),
    ]
    pieces = [
        s.hull(s.round_piece(27.0, -8.0, -6.5), s.round_piece(20.0, -8.0, -1.5)),
        s.round_piece(20.0, -1.5, 1.5),
        s.hull(s.round_piece(27.0, 6.5, 8.0), s.round_piece(20.0, 1.5, 8.0)),
        s.round_piece(11.0, 8.0, 19.0),
    ]
    return s.finish("vee_pulley", s.revolve(profile), pieces, WHITE_POM, SymmetryGroup.revolution())
