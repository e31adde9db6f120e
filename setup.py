"""Stops a build from a checkout without links; all that is built stands in pyproject.toml."""

from pathlib import Path

from setuptools import setup

LINKS = ("assets", "envs", "estimators")

package = Path(__file__).parent / "simpick"
if missing := [name for name in LINKS if not (package / name).is_dir()]:
    links, targets = (", ".join(f"{folder}/{name}" for name in missing) for folder in ("simpick", ".."))
    raise SystemExit(
        f"simpick cannot be built from this checkout: {links} must be symbolic links to {targets}, but Git made text "
        "files of them or left them out. On Windows, turn on Developer Mode and clone again with: "
        "git clone -c core.symlinks=true URL"
    )
setup()
