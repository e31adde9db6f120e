"""Configurations whose fields declare their types and ranges, and one loader of dataclasses from JSON.

A configuration is a frozen dataclass derived from `Config`. Annotations state what a field may hold, and `Config`
checks them when an object is made; `_check_rules` holds the rules between fields:

    @dataclass(frozen=True)
    class TrainConfig(Config):
        batch: PositiveInt = 32
        parts: PositiveInt = 4
        width_m: Annotated[float, Interval(gt=0, le=1), "give metres, not millimetres"] = 0.3

        def _check_rules(self) -> None:
            if self.batch % self.parts:
                raise ConfigError(f"parts must divide batch, got parts={self.parts}, batch={self.batch}")

Ranges are written with `annotated_types`, the vocabulary of pydantic and hypothesis; type checkers and tyro read the
plain type. A string beside a range is the remedy at the end of its error.

The check itself is ours: pydantic costs 0.13 s to import and reports errors over several lines in its own names;
msgspec and cattrs check only what they load, not what Python code constructs, and msgspec stops at the first error and
accepts unknown keys of dataclasses.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import operator
import types
from collections.abc import Callable, Iterator
from difflib import get_close_matches
from enum import Enum
from functools import cache
from numbers import Integral, Real
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from annotated_types import Ge, GroupedMetadata, Gt, Interval, Le, Lt, MinLen

from simpick.errors import ConfigError, UnknownNameError
from simpick.json_text import load_json

PositiveInt = Annotated[int, Ge(1)]
NonNegativeInt = Annotated[int, Ge(0)]
PositiveFloat = Annotated[float, Gt(0)]
NonNegativeFloat = Annotated[float, Ge(0)]
Fraction = Annotated[float, Interval(ge=0, le=1)]

_T = TypeVar("_T")
_INTEGERS_END = 2**64
"""Integers are smaller, whatever their sign: seeds have 64 bits, nothing has more."""
_SHOWN_CHARACTERS = 200
_UNIONS = (Union, types.UnionType)
_Bound = tuple[str, Callable[[Any, Any], bool], Any]  # in words, the comparison, the limit
_BOUNDS: dict[type, tuple[str, str, Callable[[Any, Any], bool]]] = {
    Gt: ("gt", "above", operator.gt),
    Ge: ("ge", "at least", operator.ge),
    Lt: ("lt", "below", operator.lt),
    Le: ("le", "at most", operator.le),
    MinLen: ("min_length", "of length at least", lambda value, least: len(value) >= least),
}
_NAMES: dict[Any, str] = {
    bool: "True or False",
    dict: "a dict (in JSON an object)",
    float: "a finite number",
    int: "an integer",
    Path: "a path",
    str: "a string",
    tuple: "a tuple (in JSON a list)",
    types.NoneType: "None",
}


class Config:
    """Base of frozen dataclasses that check their fields when they are made.

    Raises:
        ConfigError: fields have the wrong type or are out of range; the message lists all of them.
    """

    def __post_init__(self) -> None:
        hints = field_types(type(self))
        found = [error for name, hint in hints.items() for error in _errors(getattr(self, name), hint, name)]
        if found:
            raise ConfigError("; ".join(found))
        self._check_rules()

    def _check_rules(self) -> None:
        """Raise ConfigError where fields contradict each other; a subclass of a configuration calls ``super()``."""

    def to_json(self) -> dict[str, Any]:
        """Return plain values that `from_json` reads."""
        return dataclasses.asdict(self)  # type: ignore[call-overload]  # subclasses are dataclasses


@cache
def field_types(kind: type) -> dict[str, Any]:
    """Return the type annotation of each field of a dataclass, with its ranges."""
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: hints[field.name] for field in dataclasses.fields(kind)}


def read_json(path: Path) -> dict[str, Any]:
    """Return the object in a JSON file.

    Raises:
        ConfigError: the file cannot be read, or is no JSON object; the message names the file.
    """
    try:
        values = load_json(path.read_bytes())
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path} must be a JSON file, cannot be read ({error})") from error
    if not isinstance(values, dict):
        raise ConfigError(f"{path} must hold a JSON object, got {_shown(values)}")
    return values


def from_json(kind: type[_T], values: object, source: str = "", *, complete: bool = False) -> _T:
    """Return a dataclass made from the values of a JSON object, nested dataclasses included.

    Types are exact: neither 64.5 nor true is an integer. Only an integer may stand for a float. Lists become tuples,
    strings paths and enums where the field asks for them. Fields without a default must be present, with `complete`
    all fields; keys that are no fields are errors. `source` is put before the message: a file, say.

    Raises:
        ConfigError: a value does not fit; the message names it by its path, such as ``data.templates.views``.
    """
    try:
        return _build(kind, values, "", complete)
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}" if source else str(error)) from error


def _build(kind: type[_T], values: object, path: str, complete: bool) -> _T:
    if not isinstance(values, dict):
        raise ConfigError(f"{path or kind.__name__} must be an object with values by name, got {_shown(values)}")
    prefix = f"{path}." if path else ""
    hints = field_types(kind)
    found = [_unknown(prefix, str(key), hints) for key in values if key not in hints]
    required = [f.name for f in dataclasses.fields(kind) if complete or _has_no_default(f)]  # type: ignore[arg-type]
    found += [f"{prefix}{name} is missing" for name in required if name not in values]
    arguments = {}
    for name, hint in hints.items():
        if name in values:
            arguments[name] = _converted(values[name], hint, prefix + name, complete)
            found += _errors(arguments[name], hint, prefix + name)
    if found:
        raise ConfigError("; ".join(found))
    try:
        return kind(**arguments)
    except (ConfigError, UnknownNameError) as error:
        raise ConfigError(f"{path}: {error}" if path else str(error)) from error


def _has_no_default(field: dataclasses.Field) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _unknown(prefix: str, key: str, names: dict[str, Any]) -> str:
    alike = get_close_matches(key, names, n=1)
    hint = f"did you mean {alike[0]!r}?" if alike else f"valid: {', '.join(names)}"
    return f"{prefix}{key} is unknown, {hint}"


def _converted(value: Any, hint: Any, path: str, complete: bool) -> Any:
    """Return the Python value of a JSON value; what does not fit stays as it is, for `_errors` to report."""
    kind, _, _, optional = _parts(hint)
    if value is None and optional:
        return None
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        return _build(kind, value, path, complete)
    if get_origin(kind) is tuple and isinstance(value, list):
        kinds = _item_types(kind, len(value))
        if len(kinds) != len(value):
            return value
        return tuple(_converted(item, kinds[i], f"{path}[{i}]", complete) for i, item in enumerate(value))
    if get_origin(kind) is dict and isinstance(value, dict):
        return {key: _converted(item, get_args(kind)[1], f"{path}.{key}", complete) for key, item in value.items()}
    if kind is float and type(value) is int and abs(value) < 2**53:
        return float(value)
    if isinstance(value, str) and isinstance(kind, type) and issubclass(kind, Path | Enum):
        with contextlib.suppress(ValueError):
            return kind(value)
    return value


def _errors(value: Any, hint: Any, name: str) -> Iterator[str]:
    """Yield what is wrong with a value."""
    kind, bounds, remedy, optional = _parts(hint)
    if value is None and optional:
        return
    if not _is_a(value, kind):
        yield f"{name} must be {_described(kind)}{' or None' * optional}, got {_shown(value)}"
        return
    if missed := _missed(value, bounds):
        yield f"{name} must be {missed}, got {_shown(value)}" + (f" ({remedy})" if remedy else "")
    if isinstance(value, tuple) and get_args(kind):
        for i, (item, item_hint) in enumerate(zip(value, _item_types(kind, len(value)), strict=True)):
            yield from _errors(item, item_hint, f"{name}[{i}]")
    elif isinstance(value, dict) and get_args(kind):
        for key, item in value.items():
            yield from _errors(item, get_args(kind)[1], f"{name}.{key}")


@cache
def _parts(hint: Any) -> tuple[Any, tuple[_Bound, ...], str, bool]:
    """Split a type annotation into the plain type, its bounds, their remedy, and whether None is allowed."""
    arms = get_args(hint)
    if get_origin(hint) is Annotated:
        kind, bounds, remedy, optional = _parts(arms[0])
        for item in arms[1:]:
            remedy = item if isinstance(item, str) else remedy
            for bound in item if isinstance(item, GroupedMetadata) else (item,):
                if type(bound) in _BOUNDS:
                    attribute, words, holds = _BOUNDS[type(bound)]
                    limit = getattr(bound, attribute)
                    bounds += ((f"{words} {limit:g}", holds, limit),)
        return kind, bounds, remedy, optional
    if get_origin(hint) in _UNIONS and len(arms) == 2 and types.NoneType in arms:
        kind, bounds, remedy, _ = _parts(arms[0] if arms[1] is types.NoneType else arms[1])
        return kind, bounds, remedy, True
    return hint, (), "", False


def _item_types(kind: Any, length: int) -> tuple[Any, ...]:
    """Return the annotations of a tuple's items: of ``tuple[X, ...]`` as many as the value has."""
    items = get_args(kind)
    return (items[0],) * length if items[-1] is Ellipsis else items


def _is_a(value: Any, kind: Any) -> bool:
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in _UNIONS:
        return any(_is_a(value, _parts(arm)[0]) for arm in arguments)
    if origin is Literal:
        return any(type(value) is type(choice) and value == choice for choice in arguments)
    if kind is int:
        return isinstance(value, int | Integral) and not isinstance(value, bool) and abs(int(value)) < _INTEGERS_END
    if kind is float:
        # An integer may exceed all floats.
        is_number = isinstance(value, float | Real) and not isinstance(value, bool)
        return is_number and (_is_a(value, int) if isinstance(value, int) else bool(abs(value) < math.inf))  # type: ignore[operator]
    if origin is tuple and arguments:
        return isinstance(value, tuple) and len(value) == len(_item_types(kind, len(value)))
    kind = origin or kind
    # What is no class (Any, a type variable) is left to the type checker.
    return not isinstance(kind, type) or isinstance(value, kind)


def _described(kind: Any) -> str:
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Literal:
        return f"one of {', '.join(map(repr, arguments))}"
    if origin in _UNIONS:
        return " or ".join(_described(_parts(arm)[0]) for arm in arguments)
    if origin is tuple and arguments[-1] is not Ellipsis:
        return f"{_NAMES[tuple]} of {len(arguments)} values"
    if isinstance(kind, type) and issubclass(kind, Enum):
        return f"one of {', '.join(repr(member.value) for member in kind)}"
    return _NAMES.get(origin or kind, f"of type {getattr(kind, '__name__', kind)}")


def _shown(value: Any) -> str:
    if isinstance(value, int) and abs(value) >= _INTEGERS_END:
        # Python refuses to write out integers of more than 4300 digits.
        return f"an integer of {value.bit_length()} bits"
    text = str(value) if isinstance(value, Real) else repr(value)
    return text if len(text) <= _SHOWN_CHARACTERS else f"{text[:_SHOWN_CHARACTERS]}..."


def _missed(value: Any, bounds: tuple[_Bound, ...]) -> str:
    """Return the range that a value is outside of, in words; empty if it is within it."""
    if all(holds(value, limit) for _, holds, limit in bounds):
        return ""
    text = " and ".join(words for words, _, _ in bounds)
    if text.startswith("at least") and "at most" in text:
        text = text.replace("at least", "between").replace("at most ", "")
    return text
