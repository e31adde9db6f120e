"""What tells one run's identity from another's, in words; nothing is loaded for it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

VERSIONS, MODE_DATA, GRASPS, PART_CONTENT = "versions", "mode_data", "verified_grasps", "content_of_parts"
"""What `simpick.experiments.provenance` states beside the settings."""


def changes(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Return what keeps results of `now` from joining those of `before`, one text a difference.

    More episodes or more modes do not: there is only more to do. The order of modes does not matter either.
    """
    told: list[str] = []
    for key in sorted(before.keys() | now.keys()):
        was, is_now = before.get(key), now.get(key)
        if was == is_now or _has_grown(key, was, is_now):
            continue
        if key == MODE_DATA and was is not None and is_now is not None:
            told += _changed_data(was, is_now)
        elif key == VERSIONS and was is not None and is_now is not None:
            told += [
                _changed(f"version of {name}", was.get(name), is_now.get(name)) for name in _differing(was, is_now)
            ]
        elif was is None and key in (VERSIONS, MODE_DATA, GRASPS):
            told.append(f"{key} (not stated there, by an older simpick)")
        else:
            told.append(_changed(key, was, is_now))
    return told


def _changed_data(was: dict[str, dict[str, str]], is_now: dict[str, dict[str, str]]) -> Iterator[str]:
    for mode in (mode for mode in _differing(was, is_now) if mode in was and mode in is_now):
        for file in _differing(was[mode], is_now[mode]):
            yield _changed(f"weights or data of mode {mode}, {file}", was[mode].get(file), is_now[mode].get(file))


def _differing(was: dict[str, Any], is_now: dict[str, Any]) -> list[str]:
    return [name for name in sorted(was.keys() | is_now.keys()) if was.get(name) != is_now.get(name)]


def _changed(what: str, was: Any, is_now: Any) -> str:
    there, here = ("none" if value is None else repr(value) for value in (was, is_now))
    return f"{what} ({there} there, {here} now)"


def _has_grown(key: str, was: Any, is_now: Any) -> bool:
    """Return whether a setting may differ because there is only more to do: episodes or modes."""
    if was is None or is_now is None:
        return False
    if key == "episodes":
        return was < is_now
    if key == "modes":
        return set(was) <= set(is_now)
    return key == MODE_DATA and all(is_now.get(mode) == data for mode, data in was.items())
