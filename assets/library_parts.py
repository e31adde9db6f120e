"""The parts that ship with simpick: their builders and their names."""

from __future__ import annotations

from collections.abc import Callable

from simpick.assets import brackets, fasteners, fittings, mechanics, mouldings
from simpick.assets.part import Part
from simpick.assets.random_parts import seed_from_name

BUILDERS: dict[str, Callable[[], Part]] = {
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
"""Functions that build each part, by its name."""


def library_part_names() -> list[str]:
    """Return the names of the parts that ship with simpick, sorted."""
    return sorted(BUILDERS)


def is_reserved_name(name: str) -> bool:
    """Return whether a user's part may not take this name."""
    return name in BUILDERS or seed_from_name(name) is not None
