"""The grippers that an arm can carry, by name: those that ship with simpick, and entry points of other packages."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points

from simpick.assets.grippers.base import Gripper
from simpick.assets.grippers.jaw import JawGripper
from simpick.assets.grippers.suction import SuctionGripper
from simpick.errors import ConfigError, UnknownNameError

ENTRY_POINT_GROUP = "simpick.grippers"
"""Each entry point of this group names a callable without arguments that returns a `Gripper`."""

GRIPPERS: dict[str, Callable[[], Gripper]] = {"jaw": JawGripper, "suction": SuctionGripper}
"""The grippers that ship with simpick."""


def gripper_names() -> list[str]:
    """Return the name of every gripper, those of other packages last."""
    return [*GRIPPERS, *(entry.name for entry in entry_points(group=ENTRY_POINT_GROUP))]


def get_gripper(name: str) -> Gripper:
    """Return the gripper of this name.

    Raises:
        UnknownNameError: no gripper has this name; the message lists those that exist.
        ConfigError: another package's gripper does not implement `Gripper`.
    """
    if name in GRIPPERS:
        return GRIPPERS[name]()
    for entry in entry_points(group=ENTRY_POINT_GROUP):
        if entry.name == name:
            return _from_entry_point(entry)
    raise UnknownNameError(
        "gripper", name, gripper_names(), f"Other packages add theirs as entry points of {ENTRY_POINT_GROUP!r}."
    )


def _from_entry_point(entry: EntryPoint) -> Gripper:
    gripper = entry.load()()
    members = [member for member in vars(Gripper) if not member.startswith("_")]
    missing = [member for member in members if not hasattr(gripper, member)]
    if missing or gripper.name != entry.name:
        wrong = f"it lacks {', '.join(missing)}" if missing else f"its name is {gripper.name!r}"
        raise ConfigError(
            f"gripper {entry.name!r} of {entry.value} must be a simpick.assets.grippers.Gripper of that name, {wrong}"
        )
    return gripper
