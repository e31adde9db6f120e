"""``simpick templates``: render and show the templates that pose estimators compare images with."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from simpick.cli.outputs import check_image, write_image
from simpick.cli.parts import PartNames
from simpick.config import Config, PositiveInt


@dataclass(frozen=True)
class TemplatesShow(Config):
    """Draw a contact sheet of a part's templates as a PNG image.

    It shows all views in order from +z to -z, then one view rotated in its image plane.
    """

    part: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="PART")]
    """A part's name, or a path to a mesh file."""
    out: Path = Path("logs/templates.png")
    """The image to write."""
    views: int = 162
    """Views on the sphere: 42, 162 or 642."""
    size_px: int = 128
    """Width and height of each template."""
    columns: PositiveInt = 18
    """Views per row of the sheet."""
    overwrite: bool = False
    """Replace the image if it exists."""

    def run(self) -> int:
        """Render the templates, or read them from the cache, and write the sheet."""
        # First, so that nothing is silent while libraries load.
        from simpick.terminal import Console

        console = Console()
        console.print_line(f"rendering {self.views} templates of {self.part}: {self.out}")
        import time

        from simpick.assets import get_part
        from simpick.rendering import TemplateConfig, load_templates, template_sheet
        from simpick.terminal import progress_bar

        config = TemplateConfig(views=self.views, size_px=self.size_px)
        check_image(self.out, overwrite=self.overwrite)
        part = get_part(self.part)
        start = time.perf_counter()
        with progress_bar(console) as bar:
            task = bar.add_task(f"rendering {part.name}", total=self.views)
            templates = load_templates(part, config, progress=lambda done, _: bar.update(task, completed=done))
        elapsed_s = time.perf_counter() - start
        write_image(self.out, template_sheet(templates, columns=self.columns))
        console.print_line(f"{len(templates)} templates of {part.name} in {elapsed_s:.2f} s: {self.out}")
        return 0


@dataclass(frozen=True)
class TemplatesMake:
    """Render the templates of parts before a run needs them."""

    parts: PartNames = ()
    """Part names or paths to mesh files."""
    views: int = 162
    """Views on the sphere: 42, 162 or 642."""
    size_px: int = 128
    """Width and height of each template."""

    def run(self) -> int:
        """Render what is not in the cache yet."""
        # First, so that nothing is silent while libraries load.
        from simpick.terminal import Console

        Console().print_line(f"rendering templates of {', '.join(self.parts) or 'all parts'}, where the cache has none")
        from simpick.assets import get_part, part_names
        from simpick.rendering import TemplateConfig, load_templates
        from simpick.terminal import track

        config = TemplateConfig(views=self.views, size_px=self.size_px)
        parts = [get_part(name) for name in self.parts or part_names()]
        for part in track(parts, "templates"):
            load_templates(part, config)
        return 0
