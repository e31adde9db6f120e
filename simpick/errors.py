"""Errors that simpick raises on purpose.

Each text says what was expected, what came, and what to do next. Everything derives from `SimpickError`, so
that the command line prints the text without a traceback, while programs catch the class they care about.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import Any


class SimpickError(Exception):
    """Base class: the message is complete and meant for a person. Comes whole out of worker processes."""

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
    """A name is not among those that exist; the message lists them."""

    def __init__(self, kind: str, name: str, valid: Iterable[str], remedy: str = "") -> None:
        self.kind, self.name, self.valid = kind, name, sorted(valid)
        alike = get_close_matches(name, self.valid, n=1)
        remedy = (f" {remedy}" if remedy else "") + (f" Did you mean {alike[0]!r}?" if alike else "")
        super().__init__(f"no {kind} named {name!r}. Valid: {', '.join(self.valid) or 'none so far'}.{remedy}")


class UnknownPartError(UnknownNameError):
    """No part has this name, nor is it a path to a mesh file."""

    def __init__(self, name: str, valid: Iterable[str]) -> None:
        super().__init__("part", name, valid, "Bring your own with a path to an STL, OBJ, PLY or GLB file.")


class MeshError(SimpickError, ValueError):
    """A mesh file cannot become a part: unreadable, empty, NaN, open, flat, or of an unlikely size."""


class RenderingUnavailableError(SimpickError, RuntimeError):
    """No OpenGL back end works here; the message names the system package to install."""


class OutputError(SimpickError, OSError):
    """A result cannot be written where it was asked for, or something else stands there already."""


class ArrayFileError(SimpickError, ValueError):
    """A file of arrays is damaged, or is another kind of file."""


class SceneError(SimpickError, RuntimeError):
    """A scene cannot be built, settled, saved or loaded."""


class SimulationFaultError(SceneError):
    """The physics diverged: not-a-number, or speeds that nothing in the cell can have. The scene is lost."""


class DatasetError(SimpickError, ValueError):
    """A data set on disk does not follow its format; the message names file, line or key."""


class CheckpointError(SimpickError, ValueError):
    """Weights are missing, damaged, foreign, of another version or of another network; the message says which."""


class WorkerDiedError(SimpickError, RuntimeError):
    """The process of one or more environments of a vector environment ended unasked."""

    def __init__(self, exit_codes: Mapping[int, int], hint: str = "") -> None:
        """Name the environments with their processes' exit codes; negative ones are signals."""
        ended = ", ".join(f"environment {k} with exit code {code}" for k, code in exit_codes.items())
        killed = " A negative code is a signal: -9 means killed, perhaps because memory ran out." * any(
            code < 0 for code in exit_codes.values()
        )
        super().__init__(
            f"worker processes ended unasked: {ended or 'unknown'}.{killed} The vector environment is closed; make a "
            f"new one, with fewer environments if memory is short.{' ' + hint if hint else ''}"
        )
