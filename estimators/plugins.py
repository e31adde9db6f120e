"""What the registries of estimators and detectors share: what answers depend on, and other packages' entry points."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, TypeVar

from simpick.errors import ConfigError, PluginError, SimpickError

_T = TypeVar("_T")


@dataclass(frozen=True, kw_only=True)
class Plugin:
    """A row of a registry: the files that answers depend on, or the entry point of another package."""

    files: tuple[Callable[[], Path], ...] = ()
    """Weights and fitted data that the answers depend on."""
    entry: EntryPoint | None = None
    """Where another package registered it; None for what ships with simpick."""

    def data(self) -> dict[str, str]:
        """Return a hash of each file that exists, by its name; for another package's plug-in, that package's version.

        Raises:
            CheckpointError: weights are needed, and this installation has none.
        """
        if self.entry is not None:
            return {f"package {self.entry.dist.name}": self.entry.dist.version} if self.entry.dist else {}
        found = [file for file in (locate() for locate in self.files) if file.is_file()]
        return {file.name: file_hash(file) for file in found}


def file_hash(file: Path) -> str:
    """Return a hash of a file's content."""
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16]


def entries_of(group: str) -> dict[str, EntryPoint]:
    """Return what other packages registered in a group of entry points, by name; the first of equal names."""
    return {entry.name: entry for entry in reversed([*entry_points(group=group)])}


def make_plugin(entry: EntryPoint, protocol: type[_T], **options: Any) -> _T:
    """Return another package's plug-in, made with those `options` that are not None.

    Raises:
        PluginError: that package cannot be imported, lacks the plug-in or cannot make it, or it lacks methods.
        ConfigError: the package's callable has no such option.
    """
    where = f"{entry.name!r}, registered by another package as {entry.group} = {entry.value},"
    given = {name: value for name, value in options.items() if value is not None}
    try:
        create = entry.load()
        unknown = given.keys() - inspect.signature(create).parameters.keys() if given else set()
        made = None if unknown else create(**given)
    except SimpickError:
        raise
    except Exception as error:
        raise PluginError(f"{where} cannot be made: {type(error).__name__}: {error}") from error
    if unknown:
        raise ConfigError(
            f"{where} takes no {', '.join(sorted(unknown))}; leave it out, or give the callable this parameter"
        )
    if not isinstance(made, protocol):
        methods = [name for name in vars(protocol) if not name.startswith("_") and not hasattr(made, name)]
        raise PluginError(f"{where} lacks {', '.join(methods)} of {protocol.__name__}, got {type(made).__name__}")
    return made
