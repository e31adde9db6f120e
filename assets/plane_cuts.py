"""Cutting a solid by planes until the convex hulls of its pieces hold little more than the solid itself.

Each cut is the one of a few dozen candidate planes that most reduces the hulls' excess volume, weighted by the root of
their size, so that a cut which only isolates a recess counts as progress. Neighbours are then merged where their common
hull adds little. The volume that the pieces hold too much is known after each step, which is what contacts depend on,
and no part of the solid is left without a piece. The work is bounded: where it is used up, pieces stay as they are and
hold more excess volume.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from manifold3d import Manifold

from simpick.assets.csg import to_trimesh
from simpick.assets.cut_estimates import cut_costs

FEW_PIECES = 16
"""Pieces are merged down to this number while the excess stays below `LARGEST_EXCESS`."""
MOST_PIECES = 32
"""Never more pieces than this: physics slows with every piece of every instance in the bin."""
SMALL_EXCESS = 0.03
"""Cutting and keeping pieces apart ends below this excess over the volume."""
LARGEST_EXCESS = 0.10
"""Excess over the volume up to which pieces are merged to `FEW_PIECES`."""

_MOST_WORK = 6_000_000
"""Sum over the candidate planes of the piece's faces + `_WORK_PER_PLANE`: 4 s to 6 s of one core. A count, not a clock:
pieces must not depend on the machine's load."""
_WORK_PER_PLANE = 300
_MOST_HULLS = 4 * MOST_PIECES
"""More hulls than this are joined by place before pairs are compared, whose number grows with the square."""
_TRIED_PLANES = 12
_ESTIMATE_ERROR = 1e-3
"""At least this many planes are cut exactly, and all whose estimated cost is within this share of the least."""
_CRUMB = 1e-4
_CONCAVE_EDGES = 24
_LEAST_ANGLE_RAD = 0.05
_SECTIONS = 7


@dataclass(frozen=True, eq=False)
class _Piece:
    solid: Manifold

    @cached_property
    def hull(self) -> Manifold:
        return self.solid.hull()

    @cached_property
    def excess(self) -> float:
        return max(0.0, self.hull.volume() - self.solid.volume())

    @cached_property
    def cost(self) -> float:
        return self.excess * self.hull.volume() ** 0.5


def cut_into_hulls(solid: Manifold) -> list[Manifold]:
    """Return convex solids that together cover `solid`."""
    volume = solid.volume()
    hulls = [piece.hull for piece in _pieces(solid, volume)]
    return _merged(_joined_by_place([hull for hull in hulls if not hull.is_empty()], _MOST_HULLS), volume)


def _pieces(solid: Manifold, volume: float) -> list[_Piece]:
    """Return the pieces of a solid, cut until their excess is small or no cut helps."""
    pieces = [_Piece(body) for body in solid.decompose() if body.volume() > _CRUMB * volume]
    done: list[_Piece] = []
    work = _MOST_WORK
    while pieces and len(pieces) + len(done) < 2 * MOST_PIECES:
        if sum(piece.excess for piece in [*pieces, *done]) < SMALL_EXCESS * volume:
            break
        worst = max(range(len(pieces)), key=lambda k: pieces[k].cost)
        piece = pieces.pop(worst)
        cut: list[_Piece] = []
        work_per_plane = piece.solid.num_tri() + _WORK_PER_PLANE
        if piece.excess > 0.1 * SMALL_EXCESS * volume and work >= work_per_plane:
            planes = _candidate_planes(piece.solid)[: work // work_per_plane]
            work -= work_per_plane * len(planes)
            cut = _best_cut(piece, planes, volume)
        if cut:
            pieces += cut
        else:
            done.append(piece)
    return [*done, *pieces]


def _best_cut(piece: _Piece, planes: list[tuple[float, float, float, float]], volume: float) -> list[_Piece]:
    """Return the pieces of the best plane's cut; none if no plane helps. Estimates choose the planes that are tried."""
    if not planes:
        return []
    price = 0.002 * volume**1.5
    costs = cut_costs(to_trimesh(piece.solid), np.array(planes), crumb=_CRUMB * volume, price=price)
    limit = max(np.sort(costs)[:_TRIED_PLANES][-1], (1 + _ESTIMATE_ERROR) * costs.min())
    best, least = [], 0.999 * piece.cost
    planes = [plane for plane, cost in zip(planes, costs, strict=True) if cost <= limit]
    for x, y, z, offset in planes:
        halves = piece.solid.split_by_plane((x, y, z), offset)
        if min(half.volume() for half in halves) < _CRUMB * volume:
            continue
        parts = [_Piece(body) for half in halves for body in half.decompose() if body.volume() > 0.1 * _CRUMB * volume]
        # Each piece more has its price, or noise in the excess would buy crumbs.
        cost = sum(part.cost for part in parts) + price * (len(parts) - 2)
        if cost < least:
            best, least = parts, cost
    return best


def _candidate_planes(solid: Manifold) -> list[tuple[float, float, float, float]]:
    """Return planes (unit normal, offset): along the faces at concave edges, across the box, through the middle."""
    mesh = to_trimesh(solid)
    vertices, centre = np.asarray(mesh.vertices), np.asarray(mesh.vertices).mean(axis=0)
    rows: list[Float[np.ndarray, "4"]] = []
    angles = np.asarray(mesh.face_adjacency_angles)
    concave = np.flatnonzero(~np.asarray(mesh.face_adjacency_convex) & (angles > _LEAST_ANGLE_RAD))
    edges = vertices[np.asarray(mesh.face_adjacency_edges)[concave]]
    weight = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1) * angles[concave]
    for k in np.argsort(-weight, kind="stable")[:_CONCAVE_EDGES]:
        first, second = np.asarray(mesh.face_normals)[np.asarray(mesh.face_adjacency)[concave[k]]]
        rows += [_plane(normal, edges[k, 0]) for normal in (first, second, first - second)]
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    for axis in np.eye(3):
        rows += [_plane(axis, low + s * (high - low)) for s in np.linspace(0, 1, _SECTIONS + 1)[1:-1]]
        rows.append(_plane(axis, centre))
    rows += [_plane(np.roll([1.0, sign, 0.0], k), centre) for k in range(3) for sign in (1.0, -1.0)]
    planes = np.stack(rows)
    planes = planes[np.isfinite(planes).all(axis=1)]
    # The same plane, but for its sign and for what no hull would show, is tried once.
    planes *= np.sign(planes[np.arange(len(planes)), np.abs(planes[:, :3]).argmax(axis=1)])[:, None]
    grid = np.array([0.02, 0.02, 0.02, 0.01 * float((high - low).max())])
    unique = np.unique(np.round(planes / grid).astype(int), axis=0, return_index=True)[1]
    return [(x, y, z, offset) for x, y, z, offset in planes[np.sort(unique)].tolist()]


def _plane(normal: Float[np.ndarray, "3"], point: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4"]:
    unit = normal / np.linalg.norm(normal)
    return np.append(unit, unit @ point)


def _joined_by_place(hulls: list[Manifold], most: int) -> list[Manifold]:
    """Return at most this many hulls: halves along the longest side of their centres, each joined to few enough."""
    if len(hulls) <= most:
        return hulls
    if most == 1:
        return [Manifold.batch_hull(hulls)]
    centres = np.array([hull.bounding_box() for hull in hulls]).reshape(-1, 2, 3).mean(axis=1)
    order = np.argsort(centres[:, np.ptp(centres, axis=0).argmax()], kind="stable").tolist()
    half = len(order) // 2
    low, high = ([hulls[k] for k in part] for part in (order[:half], order[half:]))
    return _joined_by_place(low, most // 2) + _joined_by_place(high, most - most // 2)


def _merged(hulls: list[Manifold], volume: float) -> list[Manifold]:
    """Return fewer hulls: pairs are replaced by their common hull, the cheapest first."""
    alive: dict[int, Manifold] = {}
    joint: dict[tuple[int, int], tuple[float, Manifold]] = {}

    def join(new: Manifold) -> None:
        number = max(alive, default=-1) + 1
        for other, hull in alive.items():
            common = Manifold.batch_hull([hull, new])
            joint[other, number] = common.volume() - hull.volume() - new.volume(), common
        alive[number] = new

    for hull in hulls:
        join(hull)
    while len(alive) > 1:
        (j, k), (added, hull) = min(joint.items(), key=lambda item: item[1][0])
        excess = sum(piece.volume() for piece in alive.values()) + added - volume
        limit = SMALL_EXCESS if len(alive) <= FEW_PIECES else LARGEST_EXCESS
        if len(alive) <= MOST_PIECES and excess > limit * volume:
            break
        del alive[j], alive[k]
        for pair in [pair for pair in joint if {j, k} & set(pair)]:
            del joint[pair]
        join(hull)
    return list(alive.values())
