"""Names for the entity tree: each MuJoCo name becomes one path part, with any characters."""

from __future__ import annotations

import rerun as rr


class EntityNames:
    """Hands out paths below each parent, never the same twice.

    MuJoCo names may hold slashes and are unique only among objects of one kind; in the entity tree a slash would
    make a child, which inherits its parent's transform, and two objects of one name would overwrite one another.
    """

    def __init__(self) -> None:
        self._taken: set[str] = set()

    def path(self, parent: str, name: str) -> str:
        """Return ``parent/name`` with `name` escaped to a single part, and underscores appended until it is free."""
        path = f"{parent}/{rr.escape_entity_path_part(name)}"
        while path in self._taken:
            path += "_"
        self._taken.add(path)
        return path
