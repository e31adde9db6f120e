"""`import_cad`: a part from a CAD file, with its unit, symmetries and collision pieces worked out."""

from __future__ import annotations

import logging
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import trimesh
from annotated_types import Interval

from simpick.assets.cad_files import SUFFIXES, load_file
from simpick.assets.cad_symmetry import cad_symmetries
from simpick.assets.convex_pieces import convex_pieces, excess_volume
from simpick.assets.csg import to_manifold, to_trimesh
from simpick.assets.mesh_cleaning import cleaned
from simpick.assets.mesh_solids import solidified
from simpick.assets.part import Material, Part
from simpick.assets.symmetry_choice import SymmetryChoice
from simpick.assets.units import Unit, choose_unit, split_unit
from simpick.config import Config, Fraction, NonNegativeFloat, NonNegativeInt
from simpick.errors import ConfigError, MeshError
from simpick.geometry.transforms import transform

_LOG = logging.getLogger(__name__)
MAX_FACES = 200_000
"""More than this slows every rendering and is never needed to recognise a part."""
_SIMPLIFY = 1e-3
_LARGEST_EXCESS = 0.1


@dataclass(frozen=True)
class CadSettings(Config):
    """How a CAD file becomes a part."""

    unit: Unit = "auto"
    """Unit of the file's coordinates; "auto" takes the most plausible (`choose_unit`)."""
    density_kg_m3: Annotated[float, Interval(ge=50, le=25000), "in kg/m^3, steel has 7850"] = 1200.0
    """Density of the solid: about 1200 for plastic, 2700 for aluminium, 7850 for steel."""
    rgb: tuple[Fraction, Fraction, Fraction] = (0.6, 0.6, 0.62)
    """Colour, each channel between 0 and 1."""
    simplify: bool = False
    """Merge facets within 0.1 % of the size while reading: for meshes with very many faces."""
    thickness_m: NonNegativeFloat = 0.0
    """Thickness given to a sheet, an open surface without volume; 0 refuses it."""
    body: NonNegativeInt = 0
    """Which body of a file with several, 1 being the largest; 0 takes all as one rigid part."""
    symmetry: SymmetryChoice = "auto"
    """Rotational symmetries: "auto" detects them, "none" has none, "revolution" takes the nearest axis."""


@dataclass(frozen=True, eq=False)
class CadImport:
    """A part made from a CAD file, and what was decided on the way."""

    part: Part
    unit: str
    metres_per_unit: float
    notes: tuple[str, ...]
    """Sentences: the choice of unit, what was repaired, the symmetry that was found."""


def load_cad(
    path: str | Path,
    *,
    unit: Unit = "auto",
    name: str | None = None,
    density_kg_m3: float = 1200.0,
    rgb: tuple[float, float, float] = (0.6, 0.6, 0.62),
    simplify: bool = False,
) -> Part:
    """Return the part of a CAD file; what was decided is logged. See `import_cad`."""
    return import_cad(path, CadSettings(unit, density_kg_m3, rgb, simplify), name=name).part


def import_cad(path: str | Path, settings: CadSettings | None = None, *, name: str | None = None) -> CadImport:
    """Return a CAD file's part with notes on what was decided and repaired.

    The part frame is the file's, moved to the centre of the bounding box: ``T_cad_part`` leads back (in metres;
    divide by `CadImport.metres_per_unit` for the file's own unit). `name` defaults to the file's, made of letters,
    digits and underscores. Raises `MeshError` if the file cannot become a part, and says what to do.
    """
    path, settings = Path(path), settings or CadSettings()
    content = load_file(path)
    _check_count(len(content.mesh.faces), path, settings.simplify)
    mesh, offset, repairs = cleaned(content.mesh, path.name)
    choice = choose_unit(float(mesh.extents.max()), settings.unit, file=path.name, stated=content.unit)
    mesh.apply_scale(choice.metres_per_unit)
    mesh, more = solidified(mesh, path.name, thickness_m=settings.thickness_m, body=settings.body)
    repairs += more
    if settings.simplify:
        mesh = _simplified(mesh, path, repairs)
    centre = mesh.bounds.mean(axis=0)
    mesh.apply_translation(-centre)
    symmetries, symmetry_note = cad_symmetries(mesh, settings.symmetry)
    collision = convex_pieces(mesh)
    part = Part(
        name=checked_name(name) if name is not None else name_from_path(path),
        mesh=mesh,
        collision=collision,
        symmetries=symmetries,
        density_kg_m3=settings.density_kg_m3,
        material=Material(settings.rgb),
        T_cad_part=transform(None, centre + offset * choice.metres_per_unit),
        metres_per_cad_unit=choice.metres_per_unit,
    )
    excess = excess_volume(mesh, collision)
    if excess > _LARGEST_EXCESS:
        repairs.append(
            f"{path.name}: collision pieces fill {excess:.0%} more than its volume (thin or strongly curved walls): "
            "parts interlock less than real ones, and the jaw grips the filled shape"
        )
    notes = [choice.note, *repairs, f"{path.name}: symmetry: {symmetry_note}"]
    for note in notes:
        _LOG.info(note)
    return CadImport(part, choice.unit, choice.metres_per_unit, tuple(notes))


def _check_count(faces: int, path: Path, simplify: bool) -> None:
    if faces > MAX_FACES and not simplify:
        raise MeshError(
            f"{path.name}: must have at most {MAX_FACES} faces, got {faces}. Export it with a coarser "
            "tolerance, or simplify it while reading (--simplify, or simplify=True)."
        )


def _simplified(mesh: trimesh.Trimesh, path: Path, notes: list[str]) -> trimesh.Trimesh:
    """Return the mesh with facets merged; as it is where nothing would be left."""
    before = len(mesh.faces)
    solid = to_manifold(mesh).simplify(_SIMPLIFY * float(mesh.extents.max()))
    if solid.is_empty():
        return mesh
    notes.append(f"{path.name}: simplified from {before} to {solid.num_tri()} faces")
    if solid.num_tri() > MAX_FACES:
        raise MeshError(
            f"{path.name}: still has {solid.num_tri()} faces after simplification, must have at most {MAX_FACES}. "
            "Export it with a coarser tolerance."
        )
    return to_trimesh(solid)


def name_from_path(path: Path) -> str:
    """Return a part name made of a file's name: lower case letters, digits and underscores."""
    name = re.sub(r"[^a-z0-9]+", "_", path.stem.lower()).strip("_")
    return name if name and not name[0].isdigit() else f"part_{name}".rstrip("_")


_NAME_CHARACTERS = 100
"""Names become parts of file names, which have at most 255 characters."""


def checked_name(name: str) -> str:
    """Return `name`, or raise `ConfigError` if it is not made of letters, digits and underscores."""
    if len(name) > _NAME_CHARACTERS:
        raise ConfigError(
            f"a part's name must have at most {_NAME_CHARACTERS} characters, got {len(name)}: {name[:60]}..."
        )
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name):
        raise ConfigError(
            f"a part's name must start with a letter and hold only letters, digits and underscores, got {name!r}"
        )
    return name


def is_mesh_path(text: str) -> bool:
    """Return whether a part's name is meant as a path: it ends like a mesh file (and a unit) or has a separator."""
    return Path(split_unit(text)[0]).suffix.lower() in SUFFIXES or "/" in text or os.sep in text
