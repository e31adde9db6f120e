"""Which differences of provenance forbid to add results to a folder, in words; nothing is loaded for it."""

from __future__ import annotations

from typing import Any

from simpick.run_folder import describe, differences

VERSIONS, MODE_DATA, GRASPS, PART_CONTENT = "versions", "mode_data", "verified_grasps", "content_of_parts"
"""What `simpick.experiments.provenance` states beside the settings."""


def changes(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Return what forbids to add results of `now` to those of `before`, one text per difference.

    More episodes or more modes do not, nor does the order of modes.
    """
    return [
        _described(path, was, is_now)
        for path, was, is_now in differences(before, now)
        if not _has_grown(path, was, is_now)
    ]


def _has_grown(path: tuple[str, ...], was: Any, is_now: Any) -> bool:
    """Return whether there is only more to do: more episodes or more modes."""
    match path:
        case ("episodes",):
            return was is not None and is_now is not None and was < is_now
        case ("modes",):
            return was is not None and is_now is not None and set(was) <= set(is_now)
        case (key, _) if key == MODE_DATA:
            # Of a mode that only one of both has; where modes were left out, "modes" reports it.
            return True
    return False


def _described(path: tuple[str, ...], was: Any, is_now: Any) -> str:
    match path:
        case (key, package) if key == VERSIONS:
            return describe(f"version of {package}", was, is_now)
        case (key, mode, file) if key == MODE_DATA:
            return describe(f"weights or data of mode {mode}, {file}", was, is_now)
        case (key,) if key in (VERSIONS, MODE_DATA, GRASPS) and was is None:
            return f"{key} (not stated there, by an older simpick)"
    return describe(".".join(path), was, is_now)
