"""The user's parts: CAD files registered under a name, so that `get_part` takes the name from then on."""

from __future__ import annotations

import json
import re
import shutil
import tempfile
from dataclasses import asdict
from pathlib import Path

from simpick.assets.cad_import import CadImport, CadSettings, checked_name, import_cad, name_from_path
from simpick.assets.library_parts import is_reserved_name
from simpick.assets.part import Part
from simpick.caching import cache_dir
from simpick.config import from_json, read_json
from simpick.errors import ConfigError, MeshError, OutputError, UnknownNameError

_SETTINGS = "part.json"


def user_parts_dir() -> Path:
    """Return the folder of registered parts, one folder each."""
    return cache_dir() / "parts"


def user_part_names() -> list[str]:
    """Return the names of registered parts, sorted."""
    folder = user_parts_dir()
    names = [entry.parent.name for entry in folder.glob(f"*/{_SETTINGS}")] if folder.is_dir() else []
    # A folder with a dot is one that another process is still filling, or was killed over.
    return sorted(name for name in names if not name.startswith("."))


def add_user_part(
    path: str | Path, settings: CadSettings | None = None, *, name: str | None = None, replace: bool = False
) -> CadImport:
    """Register a CAD file under a name, so that `get_part` takes the name from now on; the file is copied.

    Everything that can go wrong with the file goes wrong here. Raises `MeshError`, and `ConfigError` if the name is
    taken by a library part, or by a registered one unless `replace`.
    """
    source, settings = Path(path), settings or CadSettings()
    name = checked_name(name) if name is not None else name_from_path(source)
    if is_reserved_name(name):
        raise ConfigError(f"a library part is already named {name!r}. Choose another name (--name).")
    target = user_parts_dir() / name
    if target.exists() and not replace:
        raise ConfigError(
            f"a part named {name!r} was added before. Choose another name (--name), or replace it (--overwrite)."
        )
    if alike := [other for other in user_part_names() if other != name and other.lower() == name.lower()]:
        raise ConfigError(
            f"a part's name must differ from others in more than the case of its letters, got {name!r} beside "
            f"{alike[0]!r}: some file systems hold one of them only. Choose another name (--name)."
        )
    imported = import_cad(source, settings, name=name)
    # The unit is written down as it was chosen, so that a later change of the rules does not change the part.
    record = {**asdict(settings), "unit": imported.unit, "file": f"model{source.suffix.lower()}", "from": source.name}
    try:
        user_parts_dir().mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(prefix=f".{name}-", dir=user_parts_dir()))
        try:
            shutil.copyfile(source, staging / record["file"])
            (staging / _SETTINGS).write_text(json.dumps(record, indent=1))
            _put(staging, target)
        finally:
            shutil.rmtree(staging, ignore_errors=True)
    except OSError as error:
        raise OutputError(
            f"cannot register {name!r} in {user_parts_dir()}: {error.strerror}. Set SIMPICK_CACHE to a folder that can "
            "be written."
        ) from error
    return imported


def user_part_file(name: str) -> Path | None:
    """Return the copy of the mesh file of a part that was added; None if there is none of this name."""
    return next((user_parts_dir() / name).glob("model.*"), None) if name in user_part_names() else None


def _put(staging: Path, target: Path) -> None:
    """Move a folder to its place; a folder that is there is deleted when the new one is in place."""
    if not target.exists():
        staging.replace(target)
        return
    earlier = staging.with_name(f"{staging.name}-earlier")
    target.replace(earlier)
    try:
        staging.replace(target)
    except OSError:
        earlier.replace(target)
        raise
    shutil.rmtree(earlier, ignore_errors=True)


def remove_user_part(name: str) -> Path:
    """Take a registered part out of the register, with its copy of the CAD file, and return the folder it lay in.

    What was made of it, such as grasps and templates, stays in the cache and is used again if the part is added again.
    Raises `ConfigError` for a library part, `UnknownNameError` if no part was registered under that name, and
    `OutputError` if the folder cannot be written.
    """
    added = user_part_names()
    if is_reserved_name(name):
        raise ConfigError(
            f"{name!r} comes with simpick and cannot be removed, only parts that you added can: "
            f"{', '.join(added) or 'none so far'}"
        )
    if name not in added:
        raise UnknownNameError("added part", name, added, "To see all parts: simpick parts list.")
    folder = user_parts_dir() / name
    try:
        # Out of sight in one step, so that no other process reads half a part.
        removed = Path(tempfile.mkdtemp(prefix=f".{name}-", dir=user_parts_dir()))
        folder.replace(removed)
        shutil.rmtree(removed)
    except OSError as error:
        raise OutputError(
            f"cannot remove {name!r} from {user_parts_dir()}: {error.strerror}. Make the folder writable, or delete "
            f"{folder} by hand."
        ) from error
    return folder


def load_user_part(name: str) -> Part:
    """Return a registered part. Raises `MeshError` if its entry is damaged."""
    folder = user_parts_dir() / name
    try:
        record = read_json(folder / _SETTINGS)
        file = record.pop("file")
        if not re.fullmatch(r"model\.[a-z0-9]+", str(file)):
            raise ConfigError(f"file must name the copy in this folder, such as model.stl, got {file!r}")
        del record["from"]
        # Entries of earlier versions lack the options that came later.
        settings = from_json(CadSettings, {**asdict(CadSettings()), **record}, complete=True)
        return import_cad(folder / file, settings, name=name).part
    except (ConfigError, KeyError, MeshError) as error:
        raise MeshError(
            f"the entry of part {name!r} in {folder} is damaged ({type(error).__name__}: {error}). Add it again: "
            f"simpick parts add FILE --name {name} --overwrite"
        ) from error
