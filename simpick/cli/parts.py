"""``simpick parts``: list parts, show them, add your own CAD files and remove them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from annotated_types import Interval

from simpick.assets.symmetry_choice import SymmetryChoice
from simpick.assets.units import Unit, split_unit
from simpick.cli.outputs import check_image, write_image
from simpick.config import Config, Fraction, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt
from simpick.errors import OutputError

if TYPE_CHECKING:
    from simpick.assets.part import Part


PartNames = Annotated[
    tuple[str, ...],
    tyro.conf.Positional,
    tyro.conf.arg(metavar="PART ...", help_behavior_hint="(default: all library and added parts)"),
]


@dataclass(frozen=True)
class PartsList:
    """List parts with size, mass, symmetry and collision pieces."""

    def run(self) -> int:
        """Print the table: the library parts, then those that were added."""
        from simpick.assets import get_part, library_part_names, part_names
        from simpick.assets.cad_symmetry import describe_symmetry
        from simpick.terminal import Console, narrow_table, track

        table = narrow_table("name", "from", "symmetry", "extents, mm", "mass, g", "pieces", title="Parts", labels=3)
        library = set(library_part_names())
        names = part_names()
        for name in track(names, "reading parts"):
            part = get_part(name)
            source = "library" if name in library else "added"
            symmetry = describe_symmetry(part.symmetries)
            table.add_row(name, source, symmetry, _extents(part), f"{part.mass_kg * 1e3:.1f}", str(len(part.collision)))
        Console().print(table)
        return 0


@dataclass(frozen=True)
class PartsShow(Config):
    """Draw a contact sheet of parts as a PNG image."""

    parts: PartNames = ()
    """Part names or paths to mesh files."""
    out: Path = Path("logs/parts.png")
    """The image to write."""
    columns: PositiveInt = 6
    """Parts per row."""
    cell_px: Annotated[int, Interval(ge=64, le=1024)] = 240
    """Side of each picture in pixels."""
    overwrite: bool = False
    """Replace the image if it exists."""

    def run(self) -> int:
        """Render the sheet and write it."""
        from simpick.assets import get_part, part_names
        from simpick.rendering.contact_sheet import contact_sheet
        from simpick.terminal import track, working

        check_image(self.out, overwrite=self.overwrite)
        names = self.parts or tuple(part_names())
        parts = [get_part(name) for name in track(names, "reading parts")]
        labels = [f"{part.name}\n{_extents(part)} mm, {part.mass_kg * 1e3:.0f} g" for part in parts]
        with working(f"drawing {len(parts)} parts"):
            sheet = contact_sheet(parts, labels, columns=self.columns, cell_px=self.cell_px)
        write_image(self.out, sheet)
        print(f"wrote {self.out}: {len(parts)} parts")
        return 0


@dataclass(frozen=True)
class PartsAdd(Config):
    """Add a CAD file as a part with a name.

    STL, OBJ, PLY, GLB and OFF are read, with simpick[cad] also STEP, 3MF and DAE.

    Every command accepts the name from then on. The file is copied.
    """

    file: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")]
    """The mesh file."""
    name: Annotated[
        str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="(default: made from the file's name)")
    ] = None
    """Letters, digits and underscores."""
    unit: Unit = "auto"
    """Unit of the file's coordinates; auto chooses the most plausible and reports why."""
    density: PositiveFloat = 1200.0
    """Density in kg/m^3: about 1200 for plastic, 2700 for aluminium, 7850 for steel."""
    rgb: tuple[Fraction, Fraction, Fraction] = (0.6, 0.6, 0.62)
    """Colour, each channel between 0 and 1."""
    simplify: bool = False
    """Merge facets within 0.1 % of the size: for meshes with very many faces."""
    thickness: NonNegativeFloat = 0.0
    """Thickness in m given to a sheet, an open surface without volume; 0 refuses it."""
    body: NonNegativeInt = 0
    """Which body of a file with several, 1 being the largest; 0 takes all as one part."""
    symmetry: SymmetryChoice = "auto"
    """Rotational symmetries: auto detects them, revolution takes the nearest axis."""
    overwrite: bool = False
    """Replace a part that was added under the same name."""

    def run(self) -> int:
        """Import the file, register it and print the unit, size and mass that it was given."""
        from simpick.assets import CadSettings, add_user_part
        from simpick.terminal import working

        file, unit = split_unit(str(self.file))
        unit = unit if self.unit == "auto" else self.unit
        settings = CadSettings(
            unit, self.density, self.rgb, self.simplify, self.thickness, self.body, self.symmetry
        )  # fmt: skip
        with working(f"reading {file}: repairs, symmetries, collision pieces"):
            imported = add_user_part(file, settings, name=self.name, replace=self.overwrite)
        part = imported.part
        for note in imported.notes:
            print(note)
        print(
            f"added {part.name!r}: {_extents(part)} mm, {part.mass_kg * 1e3:.1f} g, {len(part.collision)} collision "
            f"pieces. Look at it: simpick parts show {part.name}"
        )
        return 0


@dataclass(frozen=True)
class PartsRemove:
    """Remove a part that was added.

    The copy of its CAD file is removed; the original file stays. So do its grasps and templates in the cache, which
    are used again if the part is added again.
    """

    name: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")]
    """Name of a part that was added; library parts cannot be removed."""

    def run(self) -> int:
        """Remove the part and print the folder of its copy."""
        from simpick.assets import remove_user_part

        folder = remove_user_part(self.name)
        print(f"removed {self.name!r} with its copy of the CAD file in {folder}")
        return 0


@dataclass(frozen=True)
class PartsOnboard(Config):
    """Save a part with its templates, for use without OpenGL.

    ``simpick estimate --part FILE`` and ``simpick.estimate`` take the file; depth is computed by Embree there (pip
    install embreex). Both machines need the same versions of simpick and torch, and of MuJoCo where both have it.
    """

    part: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="PART")]
    """A part's name, or a path to a mesh file."""
    out: Path
    """The file to write, named .simpick."""
    mode: str = "refined"
    """The estimator that the part is onboarded at: retrieval, coarse, fine, refined or retrieval_refined."""
    detections: str = "learned"
    """The detector that the part is onboarded at."""
    unit: Unit = "auto"
    """Unit of a mesh file; auto chooses by plausible size."""
    overwrite: bool = False
    """Replace the file if it exists."""

    def run(self) -> int:
        """Onboard the part and write the file."""
        from simpick.estimators.detections import find_detector
        from simpick.estimators.registry import load_estimator
        from simpick.photos import save_onboarding
        from simpick.photos.parts import load_parts
        from simpick.terminal import working

        if self.out.exists() and not self.overwrite:
            raise OutputError(f"{self.out} exists already. Choose another file with --out, or pass --overwrite.")
        with working(f"onboarding {self.part}"):
            (part,) = load_parts([self.part], self.unit)
            plugins = [load_estimator(self.mode), find_detector(self.detections).make()]
            save_onboarding(self.out, part, plugins)
        print(f"wrote {self.out}: {part.name}, {self.out.stat().st_size / 1e6:.1f} MB")
        return 0


def describe_files(parts: Iterable[str], gripper: str) -> list[str]:
    """Return what to know before a run starts: size and mass of parts that are files, and parts hard to grip.

    Raises:
        UnknownPartError, MeshError: a file does not exist or cannot be a part.
        ConfigError: the gripper can hold none of the parts.
    """
    from simpick.assets import get_part
    from simpick.assets.cad_import import is_mesh_path
    from simpick.errors import ConfigError
    from simpick.grasping.part_report import difficulties, gripping, no_grasp_reason
    from simpick.terminal import track

    lines = []
    names = list(dict.fromkeys(parts))
    options = {name: gripping(get_part(name), gripper) for name in track(names, "checking grasps")}
    for name, option in options.items():
        part = get_part(name)
        if is_mesh_path(name):
            lines.append(
                f"{name}: {_extents(part)} mm and {part.mass_kg * 1e3:.1f} g at {part.density_kg_m3:g} kg/m^3; "
                f"for another unit, append it ({split_unit(name)[0]}@cm); for another density: simpick parts add"
            )
        lines += [f"{part.name}: {reason}" for reason in difficulties(part, [option])]
    if options and not any(option.is_possible for option in options.values()):
        reasons = "; ".join(f"{name}: {no_grasp_reason(option)}" for name, option in options.items())
        raise ConfigError(
            f"the {gripper} gripper can hold none of these parts: {reasons}. Choose another with --gripper; to compare "
            "them: simpick parts check FILE"
        )
    return lines


def _extents(part: Part) -> str:
    return " x ".join(f"{extent * 1e3:.0f}" for extent in part.extents_m)
