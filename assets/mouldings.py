"""Library parts with thin or moulded shapes: knobs, clips and housings. Dimensions in millimetres."""

from __future__ import annotations

from simpick.assets import csg as s
from simpick.assets.materials import BLACK_NYLON, GREEN_POLYAMIDE, GREY_PVC, ORANGE_ABS, RED_ANODISED
from simpick.assets.part import Part
from simpick.geometry.symmetry import SymmetryGroup


def star_knob() -> Part:
    """Star knob with five lobes and a stud: a symmetry that no box shares."""
    # Five copies of everything keep the facets five-fold.
    lobe = s.extrude(s.circle(7.0, (15.0, 0.0), facets=40), 0.0, 16.0)
    dome = s.revolve([(0, 0), (21.0, 0), (22.5, 1.5), (22.5, 11.0), (17.0, 15.0), (0, 16.0)], facets=60)
    body = s.union(s.cylinder(15.5, 0.0, 16.0, facets=60), *s.ring_of(lobe, 5)) ^ dome
    neck = s.revolve([(0, -5), (8.5, -5), (10.0, 0.5), (0, 0.5)], facets=60)
    stud = s.revolve([(0, -26), (4.4, -26), (5.2, -25), (5.2, -4), (0, -4)], facets=60)
    rough_lobe = s.extrude(s.circle(7.2, (15.0, 0.0), facets=10), 0.0, 13.0)
    core = s.hull(s.cylinder(13.5, 0.0, 14.0, facets=20), s.cylinder(8.0, 0.0, 15.6, facets=10))
    pieces = s.ring_of(s.hull(rough_lobe, core), 5)
    pieces += [s.hull(s.round_piece(8.5, -5.0, -4.0), s.round_piece(9.8, -0.5, 0.0)), s.round_piece(5.2, -26.0, -5.0)]
    return s.finish("star_knob", s.union(body, neck, stud), pieces, BLACK_NYLON, SymmetryGroup.cyclic(5))


def snap_clip() -> Part:
    """U-shaped snap clip: two arms with hooks, and a thumb tab on one of them."""
    outline = [
        (-18, 0),
        (18, 0),
        (18, 24),
        (13, 30),
        (10.5, 24),
        (14, 22),
        (14, 5),
        (-14, 5),
        (-14, 26),
        (-10.5, 28),
        (-13, 34),
        (-18, 28),
    ]
    tab = [(-30, 27), (-28, 24), (-16, 18), (-16, 24), (-27, 29)]
    body = s.upright(s.extrude(s.polygon(outline, round_corners=0.8), -11.0, 11.0))
    thumb = s.upright(s.extrude(s.polygon(tab), -6.0, 6.0))
    hole = s.cylinder(3.5, -1.0, 6.0, facets=24).translate((5.0, 0.0, 0.0))
    pieces = [
        s.box((-18, -11, 0), (18, 11, 5)),
        s.box((14, -11, 5), (18, 11, 24)),
        s.box((-18, -11, 5), (-14, 11, 28)),
        s.upright(s.extrude(s.polygon([(10.5, 24), (14, 22), (18, 24), (13, 30)]), -11.0, 11.0)),
        s.upright(s.extrude(s.polygon([(-18, 28), (-14, 26), (-10.5, 28), (-13, 34)]), -11.0, 11.0)),
        thumb,
    ]
    return s.finish("snap_clip", s.cut(s.union(body, thumb), hole), pieces, ORANGE_ABS)


def sensor_housing() -> Part:
    """Open sensor housing: walls of 3, two ears, two screw posts and a cable gland."""
    shell = s.extrude(s.rounded(s.rectangle((-28, -18), (28, 18)), 3.0), 0.0, 24.0)
    cavity = s.extrude(s.rounded(s.rectangle((-25, -15), (25, 15)), 2.0), 3.0, 25.0)
    ears = [
        s.extrude(s.rounded(s.rectangle((24, -18), (39, -5)), 3.0), 0.0, 5.0),
        s.extrude(s.rounded(s.rectangle((-39, 5), (-24, 18)), 3.0), 19.0, 24.0),
    ]
    gland = s.along_x(s.cylinder(6.5, 26.0, 37.0)).translate((0.0, 6.0, 13.0))
    posts = [s.cylinder(3.6, 2.0, 20.0, facets=24).translate((x, y, 0.0)) for x, y in ((-21.0, -11.0), (20.0, -11.5))]
    tools = [s.cylinder(2.2, -1.0, 26.0, facets=24).translate((x, y, 0.0)) for x, y in ((33.5, -11.5), (-33.5, 11.5))]
    tools += [s.cylinder(1.5, 8.0, 26.0, facets=16).translate((x, y, 0.0)) for x, y in ((-21.0, -11.0), (20.0, -11.5))]
    tools += [s.along_x(s.cylinder(3.5, 20.0, 40.0, facets=24)).translate((0.0, 6.0, 13.0))]
    solid = s.cut(s.union(s.cut(shell, cavity), *ears, gland, *posts), *tools)
    pieces = [
        s.box((-28, -18, 0), (28, 18, 3)),
        s.box((-28, -18, 3), (28, -15, 24)),
        s.box((-28, 15, 3), (28, 18, 24)),
        s.box((-28, -15, 3), (-25, 15, 24)),
        s.box((25, -15, 3), (28, 15, 24)),
        *ears,
        s.along_x(s.round_piece(6.5, 28.0, 37.0)).translate((0.0, 6.0, 13.0)),
        *posts,
    ]
    return s.finish("sensor_housing", solid, pieces, GREY_PVC)


def cable_clip() -> Part:
    """P-clip: a loop of 18 bore with a flat tab."""
    loop = s.upright(s.circle(13.0).extrude(15.0).translate((0.0, 0.0, -7.5)))
    tab = s.union(s.box((0, -7.5, -13.0), (22, 7.5, -5.0)), s.cylinder(7.5, -13.0, -5.0).translate((22.0, 0.0, 0.0)))
    bore = s.upright(s.cylinder(9.0, -8.0, 8.0))
    hole = s.cylinder(3.3, -14.0, -4.0, facets=24).translate((21.0, 0.0, 0.0))
    split = s.box((8.0, -8.0, -9.6), (40.0, 8.0, -8.4))
    pieces = [s.upright(p) for p in s.ring_pieces(s.round_outline(13.0), 9.0, -7.5, 7.5)]
    outline = s.rectangle((9.0, -7.5), (22.0, 7.5)) + s.circle(7.5, (22.0, 0.0), facets=16)
    pieces += [s.extrude(outline, -13.0, -5.0)]
    return s.finish("cable_clip", s.cut(s.union(loop, tab), bore, hole, split), pieces, RED_ANODISED)


def terminal_block() -> Part:
    """Three-way terminal block: a stepped body with screw wells, wire entries and a rail foot."""
    outline = [(-16, 0), (12, 0), (12, 10), (16, 10), (16, 17), (5, 17), (5, 25), (-9, 25), (-9, 17), (-16, 17)]
    body = s.upright(s.extrude(s.polygon(outline), -17.0, 17.0))
    ways = (-10.5, 0.0, 10.5)
    wells = [s.cylinder(3.2, 19.0, 26.0, facets=24).translate((-2.0, y, 0.0)) for y in ways]
    entries = [s.box((-17.0, y - 3.2, 4.0), (-7.0, y + 3.2, 11.0)) for y in ways]
    peg = s.upright(s.cylinder(3.5, 17.0, 20.5, facets=24)).translate((-2.0, 0.0, 9.0))
    pieces = [
        s.box((-16, -17, 0), (12, 17, 17)),
        s.box((12, -17, 10), (16, 17, 17)),
        s.box((-9, -17, 17), (5, 17, 25)),
        peg,
    ]
    return s.finish("terminal_block", s.cut(s.union(body, peg), *wells, *entries), pieces, GREEN_POLYAMIDE)
