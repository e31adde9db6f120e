"""``simpick parts check``: one page about a CAD file before anything is picked."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from annotated_types import MinLen

from simpick.assets.symmetry_choice import SymmetryChoice
from simpick.assets.units import Unit, split_unit
from simpick.config import Config, NonNegativeFloat, NonNegativeInt, PositiveFloat

if TYPE_CHECKING:
    from simpick.assets.cad_import import CadImport
    from simpick.grasping.part_report import Gripping
    from simpick.terminal import Console


@dataclass(frozen=True)
class PartsCheck(Config):
    """Report what a CAD file is and how well it can be picked.

    One page: unit, repairs, mass, symmetry, resting poses, grasps by gripper, and what will be hard.

    Nothing is registered. A new part's grasps are verified in simulation, which takes up to a minute. A file without
    volume is drawn with its open edges.
    """

    file: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")]
    """The CAD file, perhaps with its unit as in block.stl@cm."""
    unit: Unit = "auto"
    """Unit of the file's coordinates; auto chooses the most plausible and reports why."""
    density: PositiveFloat = 1200.0
    """Density in kg/m^3: about 1200 for plastic, 2700 for aluminium, 7850 for steel."""
    simplify: bool = False
    """Merge facets within 0.1 % of the size: for meshes with very many faces."""
    thickness: NonNegativeFloat = 0.0
    """Thickness in m given to a sheet, an open surface without volume; 0 refuses it."""
    body: NonNegativeInt = 0
    """Which body of a file with several, 1 being the largest; 0 takes all as one part."""
    symmetry: SymmetryChoice = "auto"
    """Rotational symmetries: auto detects them, revolution takes the nearest axis."""
    grippers: Annotated[tuple[str, ...], MinLen(1)] = ("jaw", "suction")
    """Grippers to try."""
    out: Path = Path("logs/open_edges.png")
    """Picture of the open edges of a file without volume."""

    def run(self) -> int:
        """Print the page; 1 if no gripper can hold the part."""
        from simpick.assets import CadSettings, import_cad
        from simpick.errors import OpenMeshError
        from simpick.grasping.part_report import gripping, recommended
        from simpick.rendering.open_edges import draw_open_edges
        from simpick.terminal import Console, progress_bar, working

        console = Console()
        path, unit = split_unit(self.file)
        settings = CadSettings(
            unit=self.unit if self.unit != "auto" else unit, density_kg_m3=self.density, simplify=self.simplify,
            thickness_m=self.thickness, body=self.body, symmetry=self.symmetry,
        )  # fmt: skip
        console.print_line(f"reading {path}")
        try:
            with working("measuring, repairing, finding symmetries and collision pieces", console):
                imported = import_cad(path, settings)
        except OpenMeshError as error:
            draw_open_edges(error.mesh, self.out)
            console.print_line(f"picture of its open edges, in red: {self.out}")
            raise
        _print_shape(imported, console)
        options = []
        with progress_bar(console) as bar:
            task = bar.add_task("", total=100)
            for name in self.grippers:
                bar.reset(task, description=f"verifying grasps for {name}, %", total=100)
                options.append(
                    gripping(imported.part, name, lambda share: bar.update(task, completed=round(100 * share)))
                )
        _print_gripping(imported, options, console)
        choice = recommended(options)
        if choice is None:
            console.print_line("no gripper can hold this part")
            return 1
        console.print_line(
            f"try: simpick run --parts {shlex.quote(self.file)} --gripper {choice.gripper} --episodes 3"
            + " (with other options than --unit, register it first: simpick parts add)"
            * (settings != CadSettings(unit))
        )
        return 0


def _print_shape(imported: CadImport, console: Console) -> None:
    from simpick.grasping.part_report import pixels_in_overhead_image, resting_poses

    part = imported.part
    size = " x ".join(f"{extent * 1e3:.4g}" for extent in part.extents_m)
    area, width = pixels_in_overhead_image(part)
    console.print_line(
        f"{part.name}: {size} mm, {part.mass_kg * 1e3:.3g} g at {part.density_kg_m3:g} kg/m^3, {len(part.mesh.faces)} "
        f"faces, {len(part.collision)} collision pieces"
    )
    for note in imported.notes:
        console.print_line(f"- {note.partition(': ')[2]}")
    console.print_line(f"- rests in {resting_poses(part)} ways, its symmetries apart")
    console.print_line(f"- covers about {area:.0f} pixels of the overhead image, {width:.0f} wide")


def _print_gripping(imported: CadImport, options: list[Gripping], console: Console) -> None:
    from simpick.grasping.part_report import difficulties, recommended
    from simpick.terminal import narrow_table

    choice = recommended(options)
    rows = [
        [f"{option.gripper}{' (recommended)' * (option is choice)}", str(option.verified), f"{option.coverage:.0%}"]
        for option in options
    ]
    console.print(narrow_table("gripper", "verified grasps", "resting poses with two", rows=rows))
    hard = list(difficulties(imported.part, options))
    console.print_line("what will be hard: " + ("nothing known" if not hard else ""))
    for reason in hard:
        console.print_line(f"- {reason}")
