"""``simpick parts``: list the parts that there are, look at them, add your own CAD, remove it again."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from simpick.assets.units import Unit

if TYPE_CHECKING:
    from simpick.assets.part import Part


@dataclass(frozen=True)
class PartsList:
    """List the library parts and those you added: size, mass, symmetry, collision pieces."""

    def run(self) -> int:
        """Print the table."""
        from rich.console import Console
        from rich.table import Table

        from simpick.assets import get_part, library_part_names, part_names
        from simpick.assets.user_parts import describe_symmetry

        table = Table(title="Parts")
        for heading in ("name", "from", "extents (mm)", "mass (g)", "symmetry", "pieces"):
            table.add_column(heading, justify="right" if heading in ("mass (g)", "pieces") else "left")
        library = set(library_part_names())
        for name in part_names():
            part = get_part(name)
            source = "library" if name in library else "added"
            symmetry = describe_symmetry(part.symmetries)
            table.add_row(name, source, _extents(part), f"{part.mass_kg * 1e3:.1f}", symmetry, str(len(part.collision)))
        Console().print(table)
        return 0


@dataclass(frozen=True)
class PartsShow:
    """Draw a contact sheet of parts as a PNG image."""

    parts: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="PART")] = ()
    """Names or paths to mesh files; all library and added parts if none is given."""
    out: Path = Path("logs/parts.png")
    """The image to write."""
    columns: int = 6
    """Parts in a row."""
    cell_px: int = 240
    """Side of each picture in pixels."""
    overwrite: tyro.conf.FlagCreatePairsOff[bool] = False
    """Replace the image if it is there already."""

    def run(self) -> int:
        """Render the sheet and write it."""
        import cv2

        from simpick.assets import get_part, part_names
        from simpick.caching import atomic_path
        from simpick.errors import ConfigError, OutputError
        from simpick.rendering.contact_sheet import contact_sheet

        if self.out.suffix.lower() != ".png":
            raise ConfigError(f"the sheet must be a .png file, got {str(self.out)!r}")
        if self.columns < 1 or not 64 <= self.cell_px <= 1024:
            raise ConfigError(
                f"columns must be at least 1 and cell_px between 64 and 1024, got {self.columns} and {self.cell_px}"
            )
        if self.out.exists() and not self.overwrite:
            raise OutputError(f"{self.out} exists already. Choose another file with --out, or pass --overwrite.")
        parts = [get_part(name) for name in self.parts or part_names()]
        labels = [f"{part.name}\n{_extents(part)} mm, {part.mass_kg * 1e3:.0f} g" for part in parts]
        sheet = contact_sheet(parts, labels, columns=self.columns, cell_px=self.cell_px)
        with atomic_path(self.out) as temporary:
            cv2.imwrite(str(temporary), sheet[:, :, ::-1])
        print(f"wrote {self.out}: {len(parts)} parts")
        return 0


@dataclass(frozen=True)
class PartsAdd:
    """Register a CAD file (STL, OBJ, PLY, GLB) under a name that every command takes from now on."""

    file: tyro.conf.Positional[Path]
    """The mesh; it is copied."""
    name: str | None = None
    """Letters, digits and underscores; made of the file's name if not given."""
    unit: Unit = "auto"
    """Unit of the file's coordinates; auto takes mm or m by plausible size and says which."""
    density: float = 1200.0
    """Density in kg/m^3: about 1200 for plastic, 2700 for aluminium, 7850 for steel."""
    rgb: tuple[float, float, float] = (0.6, 0.6, 0.62)
    """Colour, each channel between 0 and 1."""
    simplify: tyro.conf.FlagCreatePairsOff[bool] = False
    """Merge facets within 0.1 % of the size: for meshes with very many faces."""
    replace: tyro.conf.FlagCreatePairsOff[bool] = False
    """Overwrite a part that was added under the same name."""

    def run(self) -> int:
        """Import the file, register it and print what was decided."""
        from simpick.assets import CadSettings, add_user_part

        settings = CadSettings(self.unit, self.density, self.rgb, self.simplify)
        imported = add_user_part(self.file, settings, name=self.name, replace=self.replace)
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
    """Remove a part that was added, with the copy of its CAD file; the file that it was added from stays.

    Grasps, templates and the like that were made of it stay in the cache, and are used if it is added again.
    """

    name: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")]
    """Name of a part that was added; library parts cannot be removed."""

    def run(self) -> int:
        """Remove the part and print where it lay."""
        from simpick.assets import remove_user_part

        folder = remove_user_part(self.name)
        print(f"removed {self.name!r} with its copy of the CAD file in {folder}")
        return 0


@dataclass(frozen=True)
class PartsCommand:
    """List the parts that there are, look at them, add your own CAD, remove it again."""

    action: tyro.conf.OmitArgPrefixes[
        Annotated[PartsList, tyro.conf.subcommand(name="list", prefix_name=False)]
        | Annotated[PartsShow, tyro.conf.subcommand(name="show", prefix_name=False)]
        | Annotated[PartsAdd, tyro.conf.subcommand(name="add", prefix_name=False)]
        | Annotated[PartsRemove, tyro.conf.subcommand(name="remove", prefix_name=False)]
    ]
    """What to do with parts."""

    def run(self) -> int:
        """Run the chosen subcommand."""
        return self.action.run()


def describe_files(parts: Iterable[str]) -> list[str]:
    """Return a line for each of these parts that is a mesh file: how large and heavy it was taken to be.

    Raises:
        UnknownPartError, MeshError: a file does not exist or cannot be a part.
    """
    from simpick.assets import get_part
    from simpick.assets.user_parts import is_mesh_path

    lines = []
    for name in filter(is_mesh_path, parts):
        part = get_part(name)
        lines.append(
            f"{name}: {_extents(part)} mm and {part.mass_kg * 1e3:.1f} g at {part.density_kg_m3:g} kg/m^3; "
            "for another unit or density, give it a name with: simpick parts add"
        )
    return lines


def _extents(part: Part) -> str:
    return " x ".join(f"{extent * 1e3:.0f}" for extent in part.extents_m)
