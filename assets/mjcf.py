"""Adding a part to a MuJoCo specification: the one place where a `Part` becomes bodies and geoms."""

from __future__ import annotations

import mujoco
import numpy as np
import trimesh
from jaxtyping import Float, UInt8

from simpick.assets.part import Material, Part
from simpick.assets.shading import split_at_creases

VISUAL_GROUP = 2
"""Geoms that cameras see and contacts ignore."""
COLLISION_GROUP = 3
"""Geoms that contacts see and cameras ignore."""
_TEXTURE_WIDTH = 256


def add_part(
    spec: mujoco.MjSpec,
    part: Part,
    body_name: str,
    *,
    free: bool = True,
    collide: bool = True,
    material: str | None = None,
    colour_faces: bool = False,
) -> mujoco.MjsBody:
    """Add one instance of `part` at the world's origin and return its body.

    Meshes are shared between instances of the same part in one `spec`. `free` gives it a free joint named
    ``<body_name>``; `collide` adds the collision pieces; `material` names a material of `spec` to use instead of
    the part's own; with `colour_faces` that material's texture colours each face (`add_face_colours`). The visual geom
    is named ``<body_name>/visual`` and lies in `VISUAL_GROUP`.
    """
    body = spec.worldbody.add_body(name=body_name)
    if free:
        body.add_freejoint(name=body_name)
    body.explicitinertial = True
    body.mass = part.mass_kg
    body.ipos = np.asarray(part.solid.center_mass)
    inertia = part.density_kg_m3 * np.asarray(part.solid.moment_inertia)
    body.fullinertia = [inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2]]

    visual = _shared_mesh(spec, f"{part.name}/visual", part.mesh, shaded=True, colour_faces=colour_faces)
    if material is None:
        material = f"{part.name}/material"
        add_material(spec, material, part.material)
    body.add_geom(
        name=f"{body_name}/visual", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=visual, material=material,
        group=VISUAL_GROUP, contype=0, conaffinity=0, mass=0.0,
    )  # fmt: skip
    for k, piece in enumerate(part.collision if collide else ()):
        mesh = _shared_mesh(spec, f"{part.name}/collision_{k}", piece)
        body.add_geom(
            name=f"{body_name}/collision_{k}", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh,
            group=COLLISION_GROUP, mass=0.0, rgba=[0.8, 0.3, 0.3, 0.4],
        )  # fmt: skip
    return body


def add_face_colours(spec: mujoco.MjSpec, name: str, face_rgb: UInt8[np.ndarray, "faces 3"]) -> str:
    """Add a texture with one pixel per face, as `add_part` with `colour_faces` looks them up, and return its name."""
    texture = np.zeros((-(-len(face_rgb) // _TEXTURE_WIDTH), _TEXTURE_WIDTH, 3), np.uint8)
    texture.reshape(-1, 3)[: len(face_rgb)] = face_rgb
    asset = spec.add_texture(
        name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=_TEXTURE_WIDTH, height=len(texture), nchannel=3
    )
    asset.data = texture.tobytes()
    return name


def _face_texcoords(faces: int) -> Float[np.ndarray, "faces 2"]:
    rows, columns = np.divmod(np.arange(faces), _TEXTURE_WIDTH)
    return np.stack([(columns + 0.5) / _TEXTURE_WIDTH, (rows + 0.5) / -(-faces // _TEXTURE_WIDTH)], axis=1)


def _shared_mesh(
    spec: mujoco.MjSpec, name: str, mesh: trimesh.Trimesh, *, shaded: bool = False, colour_faces: bool = False
) -> str:
    if spec.mesh(name) is None:
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        # Inertia comes from the body, so shells and thin pieces need no volume here.
        asset = spec.add_mesh(name=name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
        if shaded:
            # MuJoCo's own normals smear the shade of a hole's rim over the flat face around it.
            vertices, normals, faces = split_at_creases(mesh)
            asset.usernormal = np.asarray(normals, np.float32).ravel()
        asset.uservert = np.asarray(vertices, np.float32).ravel()
        asset.userface = np.asarray(faces, np.int32).ravel()
        if colour_faces:
            # All corners of a face look up the same pixel, so that neither filtering nor mipmaps mix colours.
            asset.usertexcoord = _face_texcoords(len(faces)).astype(np.float32).ravel()
            asset.userfacetexcoord = np.repeat(np.arange(len(faces), dtype=np.int32), 3)
    return name


def add_material(spec: mujoco.MjSpec, name: str, look: Material) -> None:
    """Add a material of this look, unless `spec` has one of this name."""
    if spec.material(name) is None:
        spec.add_material(
            name=name, rgba=[*look.rgb, 1.0],
            specular=look.specular, shininess=look.shininess, reflectance=look.reflectance,
        )  # fmt: skip
