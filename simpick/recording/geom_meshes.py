"""Triangle meshes, colours and textures of a MuJoCo model's geoms: what a viewer other than MuJoCo's needs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np
import trimesh
from jaxtyping import Float, Int, UInt8

from simpick.assets.shading import split_at_creases

_SEGMENTS = 24
"""Sides of a round primitive."""
_TEXTURE_PX = 512
"""Side of a plane's baked texture."""
_DEFAULT_RGBA = np.array([0.5, 0.5, 0.5, 1.0], np.float32)
"""MuJoCo's default geom colour, which a material overrides."""


@dataclass(frozen=True, eq=False)
class GeomMesh:
    """One geom as triangles, in the geom's own frame (metres)."""

    vertices: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "m 3"]
    rgba: tuple[float, float, float, float]
    """Colour in [0, 1]; multiplies the texture if there is one."""
    texcoords: Float[np.ndarray, "n 2"] | None = None
    """From the texture's top left corner, u right and v down."""
    texture: UInt8[np.ndarray, "height width channels"] | None = None


def geom_mesh(model: mujoco.MjModel, geom: int) -> GeomMesh | None:
    """Return a geom's mesh, or None for a kind without its own surface (flex, skin, lines).

    Planes without bounds are drawn out to twice the model's extent. A texture is kept on meshes with texture
    coordinates and on planes; elsewhere its mean colour tints the geom.
    """
    kind = mujoco.mjtGeom(int(model.geom_type[geom]))
    size = model.geom_size[geom].astype(float)
    rgba, material = _rgba(model, geom)
    texture = _texture(model, material)
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        return _plane(model, size, rgba, material, texture)
    if kind in (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF):
        mesh = _model_mesh(model, int(model.geom_dataid[geom]), rgba)
        if mesh.texcoords is not None and texture is not None:
            return replace(mesh, texture=texture)
        mesh = replace(mesh, texcoords=None)
    elif kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        mesh = _height_field(model, int(model.geom_dataid[geom]), rgba)
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        mesh = _box(size, rgba)
    elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        mesh = _ellipsoid(size[[0, 0, 0]], rgba)
    elif kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        mesh = _ellipsoid(size, rgba)
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        mesh = _revolve([_capsule_profile(size[0], size[1])], rgba)
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        mesh = _revolve(_cylinder_profiles(size[0], size[1]), rgba)
    else:
        return None
    return mesh if texture is None else replace(mesh, rgba=_tinted(mesh.rgba, texture))


def _rgba(model: mujoco.MjModel, geom: int) -> tuple[tuple[float, float, float, float], int]:
    # The rule of MuJoCo's own visualiser: a material's colour applies unless the geom has its own.
    rgba, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    if material >= 0 and np.array_equal(rgba, _DEFAULT_RGBA):
        rgba = model.mat_rgba[material]
    r, g, b, a = (float(np.clip(value, 0.0, 1.0)) for value in rgba)
    return (r, g, b, a), material


def _texture(model: mujoco.MjModel, material: int) -> np.ndarray | None:
    if material < 0:
        return None
    roles = model.mat_texid[material]
    texture = int(max(roles[mujoco.mjtTextureRole.mjTEXROLE_RGB], roles[mujoco.mjtTextureRole.mjTEXROLE_RGBA]))
    if texture < 0:
        return None
    height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
    channels, start = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
    pixels = model.tex_data[start : start + height * width * channels].reshape(height, width, channels)
    return np.repeat(pixels, 3, axis=-1) if channels == 1 else pixels.copy()


def _tinted(
    rgba: tuple[float, float, float, float], texture: UInt8[np.ndarray, "height width channels"]
) -> tuple[float, float, float, float]:
    mean = texture[..., :3].reshape(-1, 3).mean(axis=0) / 255.0
    r, g, b = (float(value) for value in np.asarray(rgba[:3]) * mean)
    return (r, g, b, rgba[3])


def _plane(
    model: mujoco.MjModel,
    size: Float[np.ndarray, "3"],
    rgba: tuple[float, float, float, float],
    material: int,
    texture: np.ndarray | None,
) -> GeomMesh:
    half = np.where(size[:2] > 0, size[:2], 2.0 * model.stat.extent)
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    vertices = np.concatenate([corners * half, np.zeros((4, 1))], axis=1)
    mesh = GeomMesh(vertices, np.tile([0.0, 0.0, 1.0], (4, 1)), np.array([[0, 1, 2], [0, 2, 3]]), rgba)
    if texture is None:
        return mesh
    # MuJoCo repeats a plane's texture; viewers may clamp at the edge, so the repeats are baked into one image.
    repeat = model.mat_texrepeat[material].astype(float)
    if not model.mat_texuniform[material]:
        repeat = repeat / np.where(size[:2] > 0, size[:2], 1.0)
    steps = (np.arange(_TEXTURE_PX) + 0.5) / _TEXTURE_PX * 2 - 1
    u = np.mod(0.5 * repeat[0] * half[0] * steps - 0.5, 1.0)
    v = np.mod(-0.5 * repeat[1] * half[1] * steps - 0.5, 1.0)
    rows = np.minimum((v * texture.shape[0]).astype(int), texture.shape[0] - 1)
    columns = np.minimum((u * texture.shape[1]).astype(int), texture.shape[1] - 1)
    # Rows of the baked image run along +y of the plane, from -y at the top.
    return replace(mesh, texcoords=(corners + 1) / 2, texture=texture[np.ix_(rows, columns)])


def _model_mesh(model: mujoco.MjModel, mesh: int, rgba: tuple[float, float, float, float]) -> GeomMesh:
    def piece(array: np.ndarray, address: np.ndarray, count: np.ndarray) -> np.ndarray:
        return array[int(address[mesh]) : int(address[mesh]) + int(count[mesh])]

    vertices = piece(model.mesh_vert, model.mesh_vertadr, model.mesh_vertnum).astype(float)
    faces = piece(model.mesh_face, model.mesh_faceadr, model.mesh_facenum)
    # Files often repeat a vertex for each face, which would make every edge look open.
    points, point_of_vertex = np.unique(vertices, axis=0, return_inverse=True)
    welded = trimesh.Trimesh(points, point_of_vertex.reshape(-1)[faces], process=False)
    # MuJoCo's own normals blur the edges of boxy meshes, so that a viewer that shades by them shows dents.
    vertices, normals, faces = split_at_creases(welded)
    if int(model.mesh_texcoordadr[mesh]) < 0:
        return GeomMesh(vertices, normals, faces, rgba)
    # Positions and texture coordinates are indexed apart; viewers need one index for both.
    texcoords = piece(model.mesh_texcoord, model.mesh_texcoordadr, model.mesh_texcoordnum).astype(float)
    texcoord_of_corner = piece(model.mesh_facetexcoord, model.mesh_faceadr, model.mesh_facenum)
    corners = np.stack([faces, texcoord_of_corner], axis=-1).reshape(-1, 2)
    unique, merged = np.unique(corners, axis=0, return_inverse=True)
    vertex, texcoord = unique.T
    return GeomMesh(vertices[vertex], normals[vertex], merged.reshape(-1, 3), rgba, texcoords[texcoord])


def _height_field(model: mujoco.MjModel, field: int, rgba: tuple[float, float, float, float]) -> GeomMesh:
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    start = int(model.hfield_adr[field])
    half_x, half_y, top, _ = model.hfield_size[field].astype(float)
    heights = top * model.hfield_data[start : start + rows * columns].reshape(rows, columns).astype(float)
    y, x = np.linspace(-half_y, half_y, rows), np.linspace(-half_x, half_x, columns)
    grid = np.stack([*np.meshgrid(x, y), heights], axis=-1)
    slope_y, slope_x = np.gradient(heights, y, x)
    normals = np.stack([-slope_x, -slope_y, np.ones_like(heights)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return GeomMesh(grid.reshape(-1, 3), normals.reshape(-1, 3), _grid_faces(rows, columns), rgba)


def _grid_faces(rows: int, columns: int) -> Int[np.ndarray, "m 3"]:
    """Return two triangles for each cell of a grid of vertices, counter-clockwise for rows along +y, columns +x."""
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.stack([corner, corner + 1, corner + columns + 1], axis=-1)
    upper = np.stack([corner, corner + columns + 1, corner + columns], axis=-1)
    return np.concatenate([lower, upper])


def _box(half: Float[np.ndarray, "3"], rgba: tuple[float, float, float, float]) -> GeomMesh:
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    vertices, normals = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            side = np.empty((4, 3))
            side[:, axis] = sign
            # The other two axes in cyclic order face along +axis; mirrored for the opposite side.
            side[:, (axis + 1) % 3], side[:, (axis + 2) % 3] = square[:, 0], square[:, 1] * sign
            vertices.append(side * half)
            normals.append(np.tile(np.eye(3)[axis] * sign, (4, 1)))
    faces = (np.arange(6)[:, None, None] * 4 + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    return GeomMesh(np.concatenate(vertices), np.concatenate(normals), faces, rgba)


def _ellipsoid(radii: Float[np.ndarray, "3"], rgba: tuple[float, float, float, float]) -> GeomMesh:
    unit = _revolve([_capsule_profile(1.0, 0.0)], rgba)
    normals = unit.normals / radii
    return replace(
        unit, vertices=unit.vertices * radii, normals=normals / np.linalg.norm(normals, axis=1, keepdims=True)
    )


def _capsule_profile(radius: float, half_length: float) -> Float[np.ndarray, "rows 4"]:
    """Return rows (radius, z, normal's radial part, normal's z part) from the lower pole to the upper one."""
    angles = np.linspace(-np.pi / 2, np.pi / 2, _SEGMENTS // 2 + 1)
    lower, upper = angles[angles <= 1e-9], angles[angles >= -1e-9]
    angle = np.concatenate([lower, upper])
    shift = np.concatenate([np.full(len(lower), -half_length), np.full(len(upper), half_length)])
    return np.stack([radius * np.cos(angle), shift + radius * np.sin(angle), np.cos(angle), np.sin(angle)], axis=1)


def _cylinder_profiles(radius: float, half_length: float) -> list[Float[np.ndarray, "rows 4"]]:
    return [
        np.array([[0.0, -half_length, 0.0, -1.0], [radius, -half_length, 0.0, -1.0]]),
        np.array([[radius, -half_length, 1.0, 0.0], [radius, half_length, 1.0, 0.0]]),
        np.array([[radius, half_length, 0.0, 1.0], [0.0, half_length, 0.0, 1.0]]),
    ]


def _revolve(profiles: list[Float[np.ndarray, "_ 4"]], rgba: tuple[float, float, float, float]) -> GeomMesh:
    """Turn profiles about z; each keeps its own normals, so that edges between them stay sharp."""
    turn = np.linspace(0, 2 * np.pi, _SEGMENTS + 1)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    vertices, normals, faces, count = [], [], [], 0
    for profile in profiles:
        for target, radial, axial in ((vertices, 0, 1), (normals, 2, 3)):
            ring = profile[:, None, [radial, radial, axial]].repeat(len(circle), axis=1)
            ring[..., :2] *= circle
            target.append(ring.reshape(-1, 3))
        faces.append(_grid_faces(len(profile), len(circle)) + count)
        count += len(vertices[-1])
    points, triangles = np.concatenate(vertices), np.concatenate(faces)
    # Where a profile touches the axis, half of its triangles have no area.
    a, b, c = (points[triangles[:, k]] for k in range(3))
    solid = np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-14
    return GeomMesh(points, np.concatenate(normals), triangles[solid], rgba)
