"""A suction head on a slim lance: a 20 mm foam face of 19 valved cells, spring-loaded and slightly tiltable.

Foam-faced area grippers pick what no plain cup seals on: narrow edges, holes, round and broken surfaces. Each cell
has a check valve: covered, it pulls with its own vacuum; open, its valve closes and the others keep theirs. So the
holding force is proportional to the number of covered cells. In MuJoCo each covered cell is a geom with adhesion, set
in the model (`geom_adhesion`) by `SuctionGripper.grip` and updated by `SuctionGripper.maintain`. Contact
adhesion belongs to the contact solver; MuJoCo's adhesion *actuator* pulls from outside of it and shakes parts of less
than 50 g loose.
"""

from __future__ import annotations

import mujoco
import numpy as np

from simpick.assets.grippers.base import GRIPPER_PREFIX, GripperBoxes, GripperSensor, GripperServo, parent_body
from simpick.assets.grippers.hold_test import HoldTest
from simpick.assets.grippers.sampling.suction import SuctionSampling
from simpick.assets.grippers.servos import SwitchServo
from simpick.assets.grippers.suction_shape import (
    BODY_LENGTH_M,
    BODY_RADIUS_M,
    CELL_CENTRES_M,
    CELL_FORCE_N,
    CELLS,
    FOAM_REACH_M,
    HEAD_LENGTH_M,
    LANCE_RADIUS_M,
    SUCTION_RADIUS_M,
    SUCTION_TURN_SYMMETRY,
    TCP_Z_M,
    suction_boxes,
)
from simpick.assets.mjcf import COLLISION_GROUP, VISUAL_GROUP
from simpick.geometry.transforms import transform

LEAST_CELLS = 3
"""Fewer covered cells than this on one part do not count as holding it."""
_CELL_RADIUS_M = 0.0012
_COVERED_COSINE = 0.7
"""A cell is covered only by a surface that faces it; one that merely touches an edge sideways leaks."""
_TRAVEL_M = 0.012
_SPRING_N_PER_M = 350.0
_PRELOAD_M = 0.002
_TILT_STIFFNESS_NM_PER_RAD = 1.0
_TILT_LIMIT_RAD = 0.26


class SuctionGripper:
    """The suction head. Implements `Gripper`."""

    name = "suction"
    tcp_site = f"{GRIPPER_PREFIX}tcp"
    T_base_tcp = transform(translation=np.array([0.0, 0.0, TCP_Z_M]))
    contact_geoms = tuple(f"{GRIPPER_PREFIX}cell_{k}" for k in range(CELLS))
    max_opening_m = 0.0
    press_m = 0.003
    turn_symmetry = SUCTION_TURN_SYMMETRY
    # At 0.8, four of 29 parts peeled off on the way to the chute; at 0.4, none of 24.
    loaded_acceleration = 0.4
    sampling = SuctionSampling()
    # Foam lets a part swing and tilt: only losing it is a failure.
    hold_test = HoldTest(tilt_deg=40.0, slip_limit_m=0.015, turn_limit_deg=30.0)
    sensor = GripperSensor("suction_sealed", "1 while the suction head holds something by vacuum", "", None)

    def add(self, spec: mujoco.MjSpec, parent: mujoco.MjsSite | mujoco.MjsBody) -> None:
        """Add the suction head at `parent`, whose +z points away from the arm."""
        base = parent_body(spec, parent, f"{GRIPPER_PREFIX}base")
        steel, shell, foam = [0.62, 0.63, 0.65, 1.0], [0.16, 0.17, 0.18, 1.0], [0.75, 0.33, 0.12, 1.0]
        _cylinder(base, f"{GRIPPER_PREFIX}adapter", 0.034, 0.0, 0.018, steel, 0.15)
        _cylinder(base, f"{GRIPPER_PREFIX}body", BODY_RADIUS_M, 0.018, BODY_LENGTH_M, shell, 0.35)
        band = _cylinder(
            base, f"{GRIPPER_PREFIX}band", BODY_RADIUS_M + 0.0005, 0.048, 0.055, [0.05, 0.35, 0.62, 1.0], 0.0
        )
        band.contype = band.conaffinity = 0
        base.add_site(name=f"{GRIPPER_PREFIX}tcp", pos=[0, 0, TCP_Z_M], size=[0.003, 0.003, 0.003], group=4)

        # The plunger's origin is the face's centre; the preload holds it against its stop until something pushes.
        plunger = base.add_body(name=f"{GRIPPER_PREFIX}plunger", pos=[0, 0, TCP_Z_M], gravcomp=1)
        plunger.add_joint(
            name=f"{GRIPPER_PREFIX}plunger",
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
        _cylinder(
            plunger, f"{GRIPPER_PREFIX}lance", LANCE_RADIUS_M, BODY_LENGTH_M - TCP_Z_M, -HEAD_LENGTH_M, steel, 0.06
        )

        head = plunger.add_body(name=f"{GRIPPER_PREFIX}head", gravcomp=1)
        for axis, name in (([1, 0, 0], "tilt_x"), ([0, 1, 0], "tilt_y")):
            head.add_joint(
                name=f"{GRIPPER_PREFIX}{name}",
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=axis,
                pos=[0, 0, -HEAD_LENGTH_M],
                range=[-_TILT_LIMIT_RAD, _TILT_LIMIT_RAD],
                limited=True,
                stiffness=_TILT_STIFFNESS_NM_PER_RAD,
                damping=0.006,
                armature=2e-5,
            )
        # Cells are the head's only contacts, for the vacuum acts on every contact of its body.
        for name, radius, top, bottom, rgba in (
            ("socket", 0.0075, -HEAD_LENGTH_M, -0.008, shell),
            ("flange", SUCTION_RADIUS_M, -0.008, -0.005, steel),
            ("foam", SUCTION_RADIUS_M, -0.005, -0.0003, foam),
        ):
            geom = _cylinder(head, f"{GRIPPER_PREFIX}{name}", radius, top, bottom, rgba, 0.008)
            geom.contype = geom.conaffinity = 0
        for k, (x, y) in enumerate(CELL_CENTRES_M):
            cell = head.add_geom(
                name=f"{GRIPPER_PREFIX}cell_{k}",
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
            spec.add_exclude(bodyname1=f"{GRIPPER_PREFIX}{one}", bodyname2=f"{GRIPPER_PREFIX}{other}")

    def boxes(self, opening_m: float) -> GripperBoxes:
        """Return boxes of head, lance and body; there is no opening, so the argument changes nothing."""
        return suction_boxes()

    def grip_boxes(self, opening_m: float) -> GripperBoxes:
        """Return none: the face only takes along what it is pressed on."""
        return np.zeros((0, 2, 3))

    def reset(self, model: mujoco.MjModel, data: mujoco.MjData, opening_m: float) -> None:
        """Relax the springs, at rest, vacuum off."""
        for name in ("plunger", "tilt_x", "tilt_y"):
            joint = model.joint(f"{GRIPPER_PREFIX}{name}")
            data.qpos[joint.qposadr[0]] = 0.0
            data.qvel[joint.dofadr[0]] = 0.0
        self.release(model, data, opening_m)

    def release(self, model: mujoco.MjModel, data: mujoco.MjData, opening_m: float) -> None:
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

    def servo(self, model: mujoco.MjModel, data: mujoco.MjData) -> GripperServo:
        """Return a switch of the vacuum, which starts off."""
        return SwitchServo(self, model, data)

    def sense(self, model: mujoco.MjModel, data: mujoco.MjData) -> float:
        """Return 1 while anything is held, else 0."""
        return float(bool(self.held_bodies(model, data)))

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

    def empty_cause(self, model: mujoco.MjModel, data: mujoco.MjData) -> str:
        """Return that no cell was covered."""
        return "the suction face found no surface to hold at stage grip"

    def covered_cells(self, model: mujoco.MjModel, data: mujoco.MjData) -> dict[int, set[int]]:
        """Return the cells that each body covers now, by body id: within the foam's reach and facing the cell."""
        first_cell = self._cells(model).start
        approach = data.body(f"{GRIPPER_PREFIX}head").xmat.reshape(3, 3)[:, 2]
        covered: dict[int, set[int]] = {}
        facing = np.abs(data.contact.frame[:, :3] @ approach) >= _COVERED_COSINE
        for first, second in data.contact.geom[facing].tolist():
            for cell, other in ((first, second), (second, first)):
                if 0 <= cell - first_cell < CELLS:
                    covered.setdefault(int(model.geom_bodyid[other]), set()).add(cell - first_cell)
        return covered

    def _cells(self, model: mujoco.MjModel) -> slice:
        """Return the ids of the cells' geoms: neighbours, for geoms of a body keep the order they are added in."""
        first = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, self.contact_geoms[0])
        return slice(first, first + CELLS)


def _cylinder(
    body: mujoco.MjsBody, name: str, radius: float, z_from: float, z_to: float, rgba: list[float], mass: float
) -> mujoco.MjsGeom:
    return body.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[radius, (z_to - z_from) / 2, 0],
        pos=[0, 0, (z_from + z_to) / 2], rgba=rgba, group=VISUAL_GROUP, mass=mass,
    )  # fmt: skip
