"""``simpick templates``: render the templates of parts and look at them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class TemplatesShow:
    """Write a contact sheet of a part's templates: all views from +z down, then one view turned in its plane."""

    part: tyro.conf.Positional[str]
    """A part's name, or a path to a mesh file."""
    out: Path = Path("logs/templates.png")
    """The image to write."""
    views: int = 162
    """Views on the sphere: 42, 162 or 642."""
    size_px: int = 128
    """Width and height of each template."""
    columns: int = 18
    """Views in a row of the sheet."""
    overwrite: bool = False
    """Replace the image if it is there already."""

    def run(self) -> int:
        """Render the templates, or take them from the cache, and write the sheet."""
        import time

        import cv2
        from rich.console import Console
        from rich.progress import Progress

        from simpick.assets import get_part
        from simpick.caching import atomic_write_bytes
        from simpick.errors import ConfigError, OutputError
        from simpick.rendering import TemplateConfig, load_templates, template_sheet

        config = TemplateConfig(views=self.views, size_px=self.size_px)
        if self.out.suffix.lower() != ".png":
            raise ConfigError(f"the sheet must be a .png file, got {str(self.out)!r}")
        part = get_part(self.part)
        if self.out.exists() and not self.overwrite:
            raise OutputError(f"{self.out} exists already. Choose another file with --out, or pass --overwrite.")
        console = Console()
        start = time.perf_counter()
        with Progress(console=console, transient=True) as bar:
            task = bar.add_task(f"rendering {part.name}", total=self.views)
            templates = load_templates(part, config, progress=lambda done, _: bar.update(task, completed=done))
        elapsed_s = time.perf_counter() - start
        sheet = template_sheet(templates, columns=self.columns)
        png = cv2.imencode(".png", cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR))[1]
        atomic_write_bytes(self.out, png.tobytes())
        console.print(f"{len(templates)} templates of {part.name} in {elapsed_s:.2f} s: {self.out}")
        return 0


@dataclass(frozen=True)
class TemplatesMake:
    """Render the templates of parts ahead of time, so that the first run does not wait for them."""

    parts: tyro.conf.Positional[tuple[str, ...]] = ()
    """Names or paths to mesh files; all library and added parts if none is given."""
    views: int = 162
    """Views on the sphere: 42, 162 or 642."""
    size_px: int = 128
    """Width and height of each template."""

    def run(self) -> int:
        """Render what is not in the cache yet."""
        from rich.progress import Progress

        from simpick.assets import get_part, part_names
        from simpick.rendering import TemplateConfig, load_templates

        config = TemplateConfig(views=self.views, size_px=self.size_px)
        parts = [get_part(name) for name in self.parts or part_names()]
        with Progress() as bar:
            task = bar.add_task("templates", total=len(parts))
            for part in parts:
                bar.update(task, description=part.name)
                load_templates(part, config)
                bar.advance(task)
        return 0


@dataclass(frozen=True)
class TemplatesCommand:
    """Render and look at the templates that pose estimators compare images with."""

    action: (
        Annotated[TemplatesShow, tyro.conf.subcommand(name="show", prefix_name=False)]
        | Annotated[TemplatesMake, tyro.conf.subcommand(name="make", prefix_name=False)]
    )

    def run(self) -> int:
        """Run the chosen subcommand."""
        return self.action.run()
