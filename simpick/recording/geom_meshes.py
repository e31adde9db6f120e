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
    elif (solid := _primitive(kind, size)) is not None:
        mesh = GeomMesh(*split_at_creases(solid), rgba)
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


def _primitive(kind: mujoco.mjtGeom, size: Float[np.ndarray, "3"]) -> trimesh.Trimesh | None:
    """Return the solid of a primitive kind, or None for other kinds; `size` as in MuJoCo."""
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return trimesh.creation.box(2 * size)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return trimesh.creation.cylinder(size[0], 2 * size[1], sections=_SEGMENTS)
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return trimesh.creation.capsule(2 * size[1], size[0], count=(_SEGMENTS // 2, _SEGMENTS))
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        radii = size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else size[[0, 0, 0]]
        return trimesh.creation.uv_sphere(count=(_SEGMENTS // 2, _SEGMENTS // 2)).apply_scale(radii)
    return None


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
