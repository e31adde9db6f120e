"""The part library: names, and `get_part`, which takes a name or a path to a mesh file."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

from simpick.assets import brackets, fasteners, fittings, mechanics, mouldings
from simpick.assets.part import Part
from simpick.errors import UnknownPartError

_BUILDERS: dict[str, Callable[[], Part]] = {
    build.__name__: build
    for build in (
        fasteners.hex_bolt,
        fasteners.hex_nut,
        fasteners.socket_screw,
        fasteners.wing_nut,
        fasteners.eye_bolt,
        fasteners.clevis_pin,
        fasteners.bushing,
        fittings.pipe_tee,
        fittings.pipe_elbow,
        fittings.hub_flange,
        fittings.tri_flange,
        fittings.hose_barb,
        brackets.l_bracket,
        brackets.z_bracket,
        brackets.clevis_fork,
        brackets.pillow_block,
        brackets.hinge_leaf,
        brackets.crane_hook,
        mechanics.connecting_rod,
        mechanics.spur_gear,
        mechanics.keyed_shaft,
        mechanics.crank_arm,
        mechanics.vee_pulley,
        mouldings.star_knob,
        mouldings.snap_clip,
        mouldings.sensor_housing,
        mouldings.cable_clip,
        mouldings.terminal_block,
    )
}


def part_names() -> list[str]:
    """Return the names that `get_part` takes, sorted."""
    return sorted(_BUILDERS)


@lru_cache(maxsize=256)
def get_part(name_or_path: str) -> Part:
    """Return a part. Raises `UnknownPartError`."""
    if name_or_path not in _BUILDERS:
        raise UnknownPartError(name_or_path, part_names())
    return _BUILDERS[name_or_path]()
