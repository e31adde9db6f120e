"""Every ``simpick`` command in README and documentation exists and takes the options that it is given."""

import re
import shlex
from importlib import import_module
from pathlib import Path

import pytest

from simpick.cli.main import COMMANDS, main

ROOT = Path(__file__).parents[2]
PAGES = [file for file in [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")] if file.name != "CHANGELOG.md"]
PLACEHOLDERS = {"N": "3"}


def commands_in(page: Path) -> list[str]:
    """Return the commands in code blocks and in inline code, without comments."""
    text = page.read_text()
    found = re.findall(r"^ {4,}(?:.* -m )?(simpick(?:\.cli\.main)? .+)$", text, re.MULTILINE)
    found += re.findall(r"`(simpick [^`\n]+)`", text)
    return [re.sub(r"\s# .*", "", command).strip() for command in found]


FOUND = sorted({(str(page.relative_to(ROOT)), command) for page in PAGES for command in commands_in(page)})


@pytest.mark.parametrize(("page", "command"), FOUND)
def test_command_in_documentation_parses(page: str, command: str, monkeypatch, capsys) -> None:
    words = [PLACEHOLDERS.get(word, word) for word in shlex.split(command)[1:]]
    # The longest, as on the command line: `train detector` begins with `train`.
    fitting = [name for name in COMMANDS if words[: len(name.split())] == name.split()]
    name = max(fitting, key=len, default=None)
    groups = {name.split()[0] for name in COMMANDS if " " in name}
    if words[0] == "COMMAND" or (words[0] in groups and len(words) == 1):
        return
    assert name is not None, f"{page} names an unknown command: {command}"
    if words == name.split():
        return
    module, _, cls = COMMANDS[name].partition(":")
    monkeypatch.setattr(getattr(import_module(f"simpick.cli.{module}"), cls), "run", lambda self: 0)
    assert main(words) == 0
    assert "is now called" not in capsys.readouterr().err


def test_commands_are_found() -> None:
    assert {page for page, _ in FOUND} >= {"README.md", "docs/results.md", "docs/tutorials/your_part.md"}
