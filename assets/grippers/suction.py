"""A suction head on a slim lance: a 20 mm foam face of 19 valved cells, spring-loaded and slightly tiltable.

Foam-faced area grippers pick what no plain cup seals on: narrow edges, holes, round and broken surfaces. Each cell
has a check valve: covered, it pulls with its own vacuum; open, its valve closes and the others keep theirs. So the
holding force is proportional to the number of covered cells. In MuJoCo each covered cell is a geom with adhesion, set
in the model (`geom_adhesion`) by `SuctionGripper.grip` and kept up to date by `SuctionGripper.maintain`. Contact
adhesion belongs to the contact solver; MuJoCo's adhesion *actuator* pulls from outside of it and shakes parts of less
than 50 g loose.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from jaxtyping import Float

from simpick.assets.grippers.base import GripperBoxes, parent_body
from simpick.assets.mjcf import COLLISION_GROUP, VISUAL_GROUP
from simpick.geometry.transforms import transform

SUCTION_RADIUS_M = 0.010
"""Radius of the foam face."""
CELLS = 19
"""Cells in the face: one in the middle, rings of 6 and 12 around it."""
CELL_FORCE_N = 1.0
"""Holding force of one covered cell: 70 kPa over its 14 mm2."""
FOAM_REACH_M = 0.002
"""How far the foam bridges to an uneven surface."""
LEAST_CELLS = 3
"""Fewer covered cells than this on one part do not count as holding it."""
_CELL_PITCH_M = 0.0042
_CELL_RADIUS_M = 0.0012
_COVERED_COSINE = 0.7
"""A cell is covered only by a surface that faces it; one that merely touches an edge sideways leaks."""
_TCP_Z_M = 0.205
_BODY_RADIUS_M = 0.024
_BODY_LENGTH_M = 0.085
_LANCE_RADIUS_M = 0.006
_HEAD_LENGTH_M = 0.012
_TRAVEL_M = 0.012
_SPRING_N_PER_M = 350.0
_PRELOAD_M = 0.002
_TILT_STIFFNESS_NM_PER_RAD = 1.0
_TILT_LIMIT_RAD = 0.26


@dataclass(frozen=True)
class SuctionGripper:
    """Handle of a suction head in a model; see `Gripper` for the methods."""

    prefix: str = "gripper/"

    kind: Literal["suction"] = "suction"
    max_opening_m: float = 0.0
    press_m: float = 0.003

    @property
    def tcp_site(self) -> str:
        """Return the name of the TCP site."""
        return f"{self.prefix}tcp"

    @property
    def actuators(self) -> tuple[str, ...]:
        """Return none: the vacuum is a property of the cells' contacts."""
        return ()

    @property
    def contact_geoms(self) -> tuple[str, ...]:
        """Return the cells."""
        return tuple(f"{self.prefix}cell_{k}" for k in range(CELLS))

    @property
    def T_base_tcp(self) -> Float[np.ndarray, "4 4"]:
        """Return the TCP frame (centre of the unloaded face) in the base frame."""
        return transform(translation=np.array([0.0, 0.0, _TCP_Z_M]))

    def boxes(self, opening_m: float = 0.0) -> GripperBoxes:
        """Return boxes of head, lance and body; there is no opening, so the argument changes nothing."""
        body_bottom = -(_TCP_Z_M - _BODY_LENGTH_M)
        lance, body, head = _LANCE_RADIUS_M, _BODY_RADIUS_M, SUCTION_RADIUS_M
        return np.array(
            [
                [[-head, -head, -_HEAD_LENGTH_M], [head, head, 0.0]],
                [[-lance, -lance, body_bottom], [lance, lance, 0.0]],
                [[-body, -body, -_TCP_Z_M], [body, body, body_bottom]],
            ]
        )

    def reset(self, model: mujoco.MjModel, data: mujoco.MjData, opening_m: float = 0.0) -> None:
        """Relax the springs, at rest, vacuum off."""
        for name in ("plunger", "tilt_x", "tilt_y"):
            joint = model.joint(f"{self.prefix}{name}")
            data.qpos[joint.qposadr[0]] = 0.0
            data.qvel[joint.dofadr[0]] = 0.0
        self.release(model, data)

    def release(self, model: mujoco.MjModel, data: mujoco.MjData, opening_m: float = 0.0) -> None:
        """Switch the vacuum off."""
        model.geom_adhesion[self._cells(model)] = 0.0

    def grip(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Switch the vacuum on if enough cells are covered now; otherwise it stays off (call again while pressing)."""
        covered = self.covered_cells(model, data)
        holds = any(len(cells) >= LEAST_CELLS for cells in covered.values())
        pulling = set().union(*covered.values()) if holds else set()
        model.geom_adhesion[self._cells(model)] = [CELL_FORCE_N if k in pulling else 0.0 for k in range(CELLS)]

    def maintain(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Let a vacuum that is on pull with the cells that are covered now, and drop it with the last of them."""
        if self.is_on(model):
            self.grip(model, data)

    def is_on(self, model: mujoco.MjModel) -> bool:
        """Return whether any cell pulls."""
        return bool(model.geom_adhesion[self._cells(model)].any())

    def opening_m(self, model: mujoco.MjModel, data: mujoco.MjData) -> float:
        """Return 0: nothing opens."""
        return 0.0

    def held_bodies(self, model: mujoco.MjModel, data: mujoco.MjData) -> tuple[int, ...]:
        """Return ids of the bodies under vacuum, those that cover most cells first."""
        if not self.is_on(model):
            return ()
        covered = self.covered_cells(model, data)
        held = [body for body, cells in covered.items() if len(cells) >= LEAST_CELLS]
        return tuple(sorted(held, key=lambda body: (-len(covered[body]), body)))

    def covered_cells(self, model: mujoco.MjModel, data: mujoco.MjData) -> dict[int, set[int]]:
        """Return the cells that each body covers now, by body id: within the foam's reach and facing the cell."""
        cells = {geom: k for k, geom in enumerate(self._cells(model))}
        approach = data.body(f"{self.prefix}head").xmat.reshape(3, 3)[:, 2]
        covered: dict[int, set[int]] = {}
        for contact in range(data.ncon):
            first, second = (int(g) for g in data.contact.geom[contact])
            if abs(data.contact.frame[contact][:3] @ approach) < _COVERED_COSINE:
                continue
            for cell, other in ((first, second), (second, first)):
                if cell in cells:
                    covered.setdefault(int(model.geom_bodyid[other]), set()).add(cells[cell])
        return covered

    def _cells(self, model: mujoco.MjModel) -> list[int]:
        return [model.geom(name).id for name in self.contact_geoms]


def _cell_centres() -> Float[np.ndarray, "cells 2"]:
    """Return where the cells lie in the face: a hexagonal pattern."""
    rows = [(i, j) for i in range(-2, 3) for j in range(-2, 3) if abs(i + j) <= 2]
    return _CELL_PITCH_M * np.array([[i + j / 2, j * np.sqrt(3) / 2] for i, j in rows])


CELL_CENTRES_M = _cell_centres()
"""Where the cells lie in the face, TCP frame."""


def add_suction_gripper(
    spec: mujoco.MjSpec, parent: mujoco.MjsSite | mujoco.MjsBody, prefix: str = "gripper/"
) -> SuctionGripper:
    """Add the suction head at `parent` (the flange's site, or any body for a floating one) and return its handle.

    The parent's +z points away from the arm.
    """
    gripper = SuctionGripper(prefix)
    base = parent_body(spec, parent, f"{prefix}base")
    steel, shell, foam = [0.62, 0.63, 0.65, 1.0], [0.16, 0.17, 0.18, 1.0], [0.75, 0.33, 0.12, 1.0]
    _cylinder(base, f"{prefix}adapter", 0.034, 0.0, 0.018, steel, 0.15)
    _cylinder(base, f"{prefix}body", _BODY_RADIUS_M, 0.018, _BODY_LENGTH_M, shell, 0.35)
    band = _cylinder(base, f"{prefix}band", _BODY_RADIUS_M + 0.0005, 0.048, 0.055, [0.05, 0.35, 0.62, 1.0], 0.0)
    band.contype = band.conaffinity = 0
    base.add_site(name=f"{prefix}tcp", pos=[0, 0, _TCP_Z_M], size=[0.003, 0.003, 0.003], group=4)

    # The plunger's origin is the face's centre; the preload holds it against its stop until something pushes.
    plunger = base.add_body(name=f"{prefix}plunger", pos=[0, 0, _TCP_Z_M], gravcomp=1)
    plunger.add_joint(
        name=f"{prefix}plunger",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[0, 0, -1],
        range=[0, _TRAVEL_M],
        limited=True,
        stiffness=_SPRING_N_PER_M,
        springref=-_PRELOAD_M,
        damping=12.0,
        armature=0.02,
    )
    # The lance ends behind the head, so that only the face touches the part.
    _cylinder(plunger, f"{prefix}lance", _LANCE_RADIUS_M, _BODY_LENGTH_M - _TCP_Z_M, -_HEAD_LENGTH_M, steel, 0.06)

    head = plunger.add_body(name=f"{prefix}head", gravcomp=1)
    for axis, name in (([1, 0, 0], "tilt_x"), ([0, 1, 0], "tilt_y")):
        head.add_joint(
            name=f"{prefix}{name}",
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=axis,
            pos=[0, 0, -_HEAD_LENGTH_M],
            range=[-_TILT_LIMIT_RAD, _TILT_LIMIT_RAD],
            limited=True,
            stiffness=_TILT_STIFFNESS_NM_PER_RAD,
            damping=0.006,
            armature=2e-5,
        )
    # Cells are the head's only contacts, for the vacuum acts on every contact of its body.
    for name, radius, top, bottom, rgba in (
        ("socket", 0.0075, -_HEAD_LENGTH_M, -0.008, shell),
        ("flange", SUCTION_RADIUS_M, -0.008, -0.005, steel),
        ("foam", SUCTION_RADIUS_M, -0.005, -0.0003, foam),
    ):
        geom = _cylinder(head, f"{prefix}{name}", radius, top, bottom, rgba, 0.008)
        geom.contype = geom.conaffinity = 0
    for k, (x, y) in enumerate(CELL_CENTRES_M):
        cell = head.add_geom(
            name=f"{prefix}cell_{k}",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[_CELL_RADIUS_M, 0, 0],
            pos=[x, y, -_CELL_RADIUS_M],
            group=COLLISION_GROUP,
        )
        cell.mass = 0.0005
        # Contacts within the gap carry vacuum without touching: the foam bridges that far.
        cell.gap = FOAM_REACH_M
        # MuJoCo leaves adhesion out of models that have none when compiled; the first `release` makes this zero.
        cell.adhesion = 1e-9
        cell.priority = 1
        cell.condim = 4
        cell.friction = [1.0, 0.002, 0.0001]
        # As stiff as the jaw's pads, and for the same reason: light parts would sink in.
        cell.solref = [0.006, 1.0]
        cell.solimp = [0.99, 0.999, 0.0005, 0.5, 2.0]

    for one, other in (("base", "plunger"), ("base", "head"), ("plunger", "head")):
        spec.add_exclude(bodyname1=f"{prefix}{one}", bodyname2=f"{prefix}{other}")
    return gripper


def _cylinder(
    body: mujoco.MjsBody, name: str, radius: float, z_from: float, z_to: float, rgba: list[float], mass: float
) -> mujoco.MjsGeom:
    geom = body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[radius, (z_to - z_from) / 2, 0],
        pos=[0, 0, (z_from + z_to) / 2],
        rgba=rgba,
        group=VISUAL_GROUP,
    )
    geom.mass = mass
    return geom
