"""The small language that parts are written in: manifold solids in millimetres, and `finish`, which makes a `Part`.

A part is written in its own frame, where its axes lie on coordinate axes; `finish` scales it to metres, moves
the origin to the centre of the bounding box and carries the symmetries along. Collision pieces are convex: what is
curved becomes a polygon of *equal area*, so that mass, rest poses and fits stay true on average.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import trimesh
from jaxtyping import Float
from manifold3d import CrossSection, JoinType, Manifold, Mesh64, OpType

from simpick.assets.materials import Stock
from simpick.assets.part import Part
from simpick.geometry.symmetry import ContinuousSymmetry, SymmetryGroup
from simpick.geometry.transforms import transform

MM = 1e-3
"""Metres in a millimetre."""
FACETS = 48
"""Facets of a round surface that is seen: a multiple of 2, 3, 4, 6, 8, 12, so that it keeps those symmetries."""
COLLISION_FACETS = 24
"""Facets of a round surface in contact."""

Point2: TypeAlias = tuple[float, float]
Point3: TypeAlias = tuple[float, float, float]


# Solids that are seen ------------------------------------------------------------------------------------------


def box(low: Point3, high: Point3) -> Manifold:
    """Return the box between two corners."""
    size = (high[0] - low[0], high[1] - low[1], high[2] - low[2])
    return Manifold.cube(size).translate(low)


def cylinder(radius: float, z0: float, z1: float, *, facets: int = FACETS, top_radius: float = -1.0) -> Manifold:
    """Return a cylinder about z from z0 to z1, or a cone if `top_radius` differs."""
    return Manifold.cylinder(z1 - z0, radius, top_radius, facets).translate((0.0, 0.0, z0))


def polygon(points: Sequence[Point2], *, round_corners: float = 0.0) -> CrossSection:
    """Return the filled polygon of these counter-clockwise points, its convex corners rounded by this radius."""
    section = CrossSection([np.asarray(points, float)])
    return rounded(section, round_corners) if round_corners else section


def rounded(section: CrossSection, radius: float) -> CrossSection:
    """Return the section with convex corners rounded: shrunk with sharp corners, then grown with round ones."""
    return section.offset(-radius, JoinType.Miter, 10.0).offset(radius, JoinType.Round, 2.0, FACETS // 2)


def rectangle(low: Point2, high: Point2) -> CrossSection:
    """Return the rectangle between two corners."""
    return CrossSection.square((high[0] - low[0], high[1] - low[1])).translate(low)


def slot(length: float, radius: float) -> CrossSection:
    """Return an oblong along x: all within `radius` of a line of this length about the origin."""
    ends = [circle(radius, (x, 0.0), facets=FACETS // 2) for x in (-0.5 * length, 0.5 * length)]
    return CrossSection.batch_hull(ends)


def circle(radius: float, centre: Point2 = (0.0, 0.0), *, facets: int = FACETS) -> CrossSection:
    """Return a disc."""
    return CrossSection.circle(radius, facets).translate(centre)


def regular(sides: int, across_flats: float) -> CrossSection:
    """Return the regular polygon of this width across flats, with a corner on +x."""
    return CrossSection.circle(0.5 * across_flats / np.cos(np.pi / sides), sides)


def extrude(section: CrossSection, z0: float, z1: float) -> Manifold:
    """Return the section swept along z from z0 to z1."""
    return section.extrude(z1 - z0).translate((0.0, 0.0, z0))


def revolve(profile: Sequence[Point2], *, facets: int = FACETS) -> Manifold:
    """Return the profile of (radius, z) points, counter-clockwise, turned about z."""
    return CrossSection([np.asarray(profile, float)]).revolve(facets)


def union(*solids: Manifold) -> Manifold:
    """Return the union."""
    return Manifold.batch_boolean(list(solids), OpType.Add)


def cut(solid: Manifold, *tools: Manifold) -> Manifold:
    """Return the solid less the tools."""
    return Manifold.batch_boolean([solid, *tools], OpType.Subtract)


def along_x(solid: Manifold) -> Manifold:
    """Turn a solid about y so that its z axis becomes x (and its x axis becomes -z)."""
    return solid.rotate((0.0, 90.0, 0.0))


def upright(solid: Manifold) -> Manifold:
    """Turn a solid about x so that its y axis becomes z (and its z axis becomes -y): a profile drawn in x-z."""
    return solid.rotate((90.0, 0.0, 0.0))


def ring_of(solid: Manifold, count: int) -> list[Manifold]:
    """Return `count` copies turned evenly about z, the first in place."""
    return [solid.rotate((0.0, 0.0, 360.0 * k / count)) for k in range(count)]


# Convex pieces for contact ---------------------------------------------------------------------------------------


def equal_area_radius(radius: float, facets: int) -> float:
    """Return the corner radius of the regular polygon that has the circle's area."""
    return radius * float(np.sqrt(2 * np.pi / (facets * np.sin(2 * np.pi / facets))))


def round_piece(
    radius: float, z0: float, z1: float, *, facets: int = COLLISION_FACETS, top_radius: float | None = None
) -> Manifold:
    """Return the collision piece of a cylinder or cone about z."""
    grow = equal_area_radius(1.0, facets)
    top = radius if top_radius is None else top_radius
    return cylinder(radius * grow, z0, z1, facets=facets, top_radius=top * grow)


def round_outline(radius: float, *, facets: int = COLLISION_FACETS) -> CrossSection:
    """Return the polygon that approximates a disc in contact."""
    return circle(equal_area_radius(radius, facets), facets=facets)


def ring_pieces(
    outline: CrossSection, bore: float, z0: float, z1: float, *, segments: int = 6, start_deg: float = 0.0
) -> list[Manifold]:
    """Return the collision pieces of a convex outline around a bore of this radius: sectors about z.

    The hole stays a hole, as a polygon of `segments` (>= 3) sides of equal area.
    """
    near, far = equal_area_radius(bore, segments), 1e3
    pieces = []
    for k in range(segments):
        angles = np.radians(start_deg) + 2 * np.pi * np.array([k, k + 1]) / segments
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        wedge = CrossSection.hull_points(np.concatenate([near * directions, far * directions]))
        pieces.append(extrude(outline ^ wedge, z0, z1))
    return pieces


def hull(*solids: Manifold) -> Manifold:
    """Return the convex hull of solids."""
    return Manifold.batch_hull(list(solids))


# From solid to part --------------------------------------------------------------------------------------------------


def to_trimesh(solid: Manifold) -> trimesh.Trimesh:
    """Return the solid as a mesh in the solid's own unit, vertices as manifold merged them."""
    mesh = solid.to_mesh64()
    # Copies: an array that lies in manifold's memory would keep all of it alive.
    vertices, faces = np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts, int)
    return trimesh.Trimesh(vertices, faces, process=False)


def to_manifold(mesh: trimesh.Trimesh) -> Manifold:
    """Return a closed mesh as a solid; it is empty, with a status that says why, if the mesh is not manifold."""
    vertices, faces = np.array(mesh.vertices, float, order="C"), np.array(mesh.faces, np.uint64, order="C")
    return Manifold(Mesh64(vertices, faces))


def finish(
    name: str,
    solid: Manifold,
    pieces: Sequence[Manifold],
    stock: Stock,
    symmetries: SymmetryGroup | None = None,
) -> Part:
    """Return the part of a solid in millimetres.

    `pieces` are replaced by their convex hulls; `symmetries` are about the solid's own origin. `Part.T_cad_part`
    leads back to the frame the solid was written in (in metres).
    """
    mesh = to_trimesh(solid).apply_scale(MM)
    centre = mesh.bounds.mean(axis=0)
    mesh.apply_translation(-centre)
    collision = tuple(to_trimesh(piece.hull()).apply_scale(MM).apply_translation(-centre) for piece in pieces)
    return Part(
        name=name,
        mesh=mesh,
        collision=collision,
        symmetries=moved(symmetries or SymmetryGroup(), -centre),
        density_kg_m3=stock.density_kg_m3,
        material=stock.look,
        T_cad_part=transform(None, centre),
    )


def moved(group: SymmetryGroup, shift: Float[np.ndarray, "3"]) -> SymmetryGroup:
    """Return the symmetries of a shape that was moved by `shift`, in metres."""
    discrete = group.discrete.copy()
    R = discrete[:, :3, :3]
    discrete[:, :3, 3] += shift - R @ shift
    discrete[np.abs(discrete) < 1e-12] = 0.0
    return SymmetryGroup(discrete, tuple(_moved_axis(axis, shift) for axis in group.continuous))


def _moved_axis(symmetry: ContinuousSymmetry, shift: Float[np.ndarray, "3"]) -> ContinuousSymmetry:
    axis = np.asarray(symmetry.axis)
    offset = np.asarray(symmetry.offset_m) + shift
    # Any point on the axis says the same; the one nearest to the origin is the shortest to read.
    offset = offset - axis * (axis @ offset)
    offset[np.abs(offset) < 1e-12] = 0.0
    return ContinuousSymmetry.of(axis, offset)
