"""mkdocs hook: what the documentation takes from the program itself.

Lines of a page are replaced: ``[[command-line]]`` by the help text of each command, and ``[[public PACKAGE]]`` by a
mkdocstrings block per name in the package's ``__all__``.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import re
from unittest import mock

from simpick.cli.main import COMMANDS, main

_MARKER = re.compile(r"^\[\[(command-line|public) ?([\w.]*)\]\]$", re.MULTILINE)


def on_page_markdown(markdown: str, **_: object) -> str:
    """Replace the markers of a page."""
    return _MARKER.sub(lambda match: _REPLACEMENTS[match[1]](match[2]), markdown)


def public_names(package: str) -> str:
    """Return a block per public class and function; those of simpick itself are on their own page only."""
    module, top = importlib.import_module(package), importlib.import_module("simpick")
    names = module.__all__ if module is top else sorted(set(module.__all__) - set(top.__all__))
    objects = [getattr(module, name) for name in names]
    return "\n\n".join(f"::: {o.__module__}.{o.__qualname__}" for o in objects if hasattr(o, "__qualname__"))


def command_line_reference(_: str) -> str:
    """Return a section per command: its help text as the terminal shows it at 80 columns."""
    sections = [f"## `simpick {name}`\n\n```text\n{help_text(name.split())}\n```" for name in COMMANDS]
    return "\n\n".join([f"```text\n{help_text([])}\n```", *sections])


def help_text(command: list[str]) -> str:
    """Return what ``simpick COMMAND --help`` prints."""
    out = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    with mock.patch.dict(os.environ, COLUMNS="80"), contextlib.redirect_stdout(out), contextlib.suppress(SystemExit):
        main([*command, "--help"])
    out.seek(0)
    return re.sub(r"\x1b\[[0-9;]*m", "", out.read()).strip()


_REPLACEMENTS = {"command-line": command_line_reference, "public": public_names}
