"""Errors that simpick raises on purpose.

Each text states what was expected, what was given, and what to do. All classes derive from `SimpickError`: the command
line prints its text without a traceback, and programs catch the class that they handle.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import Any


class SimpickError(Exception):
    """Base class. The message is complete and written for users; worker processes pass it on unchanged."""

    def __reduce__(self) -> tuple[Any, ...]:
        # Exceptions are unpickled by calling their class with the message, which is not what subclasses take.
        return _rebuilt, (type(self), self.args, self.__dict__)


def _rebuilt(kind: type[SimpickError], arguments: tuple, attributes: dict) -> SimpickError:
    error = kind.__new__(kind, *arguments)
    error.__dict__.update(attributes)
    return error


class ConfigError(SimpickError, ValueError):
    """A setting is out of range or contradicts another."""


class UnknownNameError(SimpickError, LookupError):
    """A name does not exist; the message lists those that do."""

    def __init__(self, kind: str, name: str, valid: Iterable[str], remedy: str = "") -> None:
        self.kind, self.name, self.valid = kind, name, sorted(valid)
        alike = get_close_matches(name, self.valid, n=1)
        remedy = (f" {remedy}" if remedy else "") + (f" Did you mean {alike[0]!r}?" if alike else "")
        super().__init__(f"no {kind} named {name!r}. Valid: {', '.join(self.valid) or 'none so far'}.{remedy}")


class UnknownPartError(UnknownNameError):
    """No part has this name, and it is no path to a mesh file."""

    def __init__(self, name: str, valid: Iterable[str]) -> None:
        formats = "STL, OBJ, PLY, GLB, OFF, STEP, 3MF, DAE"
        super().__init__("part", name, valid, f"A path to a CAD file ({formats}) is a part, too.")


class MeshError(SimpickError, ValueError):
    """A mesh file cannot become a part: unreadable, empty, NaN, open, flat, or of an unlikely size."""


class OpenMeshError(MeshError):
    """A mesh encloses no volume; `mesh` is what was read, in metres, so that its open edges can be drawn."""

    def __init__(self, message: str, mesh: Any) -> None:
        super().__init__(message)
        self.mesh = mesh


class RenderingUnavailableError(SimpickError, RuntimeError):
    """No OpenGL back end works here; the message names the system package to install."""


class OutputError(SimpickError, OSError):
    """A result cannot be written to its place, or would replace something else."""


class ArrayFileError(SimpickError, ValueError):
    """A file of arrays is damaged, or is another kind of file."""


class SceneError(SimpickError, RuntimeError):
    """A scene cannot be built, settled, saved or loaded."""


class SimulationFaultError(SceneError):
    """The physics diverged: NaN, or impossible speeds. The scene cannot be used any more."""


class CameraFileError(SimpickError, ValueError):
    """A camera's calibration cannot be read, or belongs to other images; the message names file and key."""


class ImageFileError(SimpickError, ValueError):
    """An image or a video cannot be read, or is of a kind that poses cannot be estimated in."""


class DatasetError(SimpickError, ValueError):
    """A data set on disk does not follow its format; the message names file, line or key."""


class CheckpointError(SimpickError, ValueError):
    """Weights are missing, damaged, of another format, version or network; the message states which."""


class PluginError(SimpickError, RuntimeError):
    """A detector or an estimator failed, or returned something that is no valid answer."""


class WorkerDiedError(SimpickError, RuntimeError):
    """The process of one or more environments of a vector environment died."""

    def __init__(self, exit_codes: Mapping[int, int], hint: str = "") -> None:
        """Take the exit code of each environment's process; negative codes are signals."""
        ended = ", ".join(f"environment {k} with exit code {code}" for k, code in exit_codes.items())
        killed = " A negative code is a signal: -9 means killed, perhaps because memory ran out." * any(
            code < 0 for code in exit_codes.values()
        )
        super().__init__(
            f"worker processes died: {ended or 'unknown'}.{killed} The vector environment is closed; make a "
            f"new one, with fewer environments if memory is short.{' ' + hint if hint else ''}"
        )
