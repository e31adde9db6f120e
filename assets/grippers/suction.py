"""A suction cup on a slim lance: a 12 mm bellows cup, 8 N of holding force, spring-loaded and slightly tiltable.

Vacuum force comes from MuJoCo's adhesion actuator, spread over the contacts of eight rubber segments that form the
lip. The actuator alone would hold on by a single touching segment, which no cup can: `SuctionGripper.grip` switches
the vacuum on only where the lip seals, and `SuctionGripper.maintain` drops it where the seal is lost. The lip seals
if all of its segments but one lie on one body and nothing under the cup is open deeper than the bellows can reach.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from jaxtyping import Float

from simpick.assets.grippers.base import GripperBoxes, largest_contact_force_n, parent_body
from simpick.assets.mjcf import COLLISION_GROUP, VISUAL_GROUP
from simpick.geometry.transforms import transform

CUP_RADIUS_M = 0.006
"""Outer radius of the lip."""
CUP_FORCE_N = 8.0
"""Holding force of a sealed cup: 70 kPa of vacuum over the lip's area."""
LIP_REACH_M = 0.002
"""How far a lip segment stretches to an uneven surface and still seals."""
CUP_DEPTH_M = 0.004
"""A surface deeper than this below the lip, inside of it, is a hole."""

_SEGMENTS = 8
_SEALING_SEGMENTS = 7
_SEGMENT_RADIUS_M = 0.001
_TCP_Z_M = 0.205
_BODY_RADIUS_M = 0.024
_BODY_LENGTH_M = 0.085
_LANCE_RADIUS_M = 0.006
_TRAVEL_M = 0.012
_SPRING_N_PER_M = 350.0
_PRELOAD_M = 0.002
_TILT_STIFFNESS_NM_PER_RAD = 0.4
_TILT_LIMIT_RAD = 0.26


@dataclass(frozen=True)
class SuctionGripper:
    """Handle of a suction cup in a model; see `Gripper` for the methods."""

    prefix: str = "gripper/"

    kind: Literal["suction"] = "suction"
    payload_kg: float = 0.4
    max_opening_m: float = 0.0
    press_m: float = 0.003

    @property
    def tcp_site(self) -> str:
        """Return the name of the TCP site."""
        return f"{self.prefix}tcp"

    @property
    def actuators(self) -> tuple[str, ...]:
        """Return the one actuator, whose control is the share of the full vacuum in [0, 1]."""
        return (f"{self.prefix}vacuum",)

    @property
    def contact_geoms(self) -> tuple[str, ...]:
        """Return the lip's segments."""
        return tuple(f"{self.prefix}lip_{k}" for k in range(_SEGMENTS))

    @property
    def T_base_tcp(self) -> Float[np.ndarray, "4 4"]:
        """Return the TCP frame (lip centre of the unloaded cup) in the base frame."""
        return transform(translation=np.array([0.0, 0.0, _TCP_Z_M]))

    def boxes(self, opening_m: float = 0.0) -> GripperBoxes:
        """Return boxes of cup, lance and body; a cup has no opening, so the argument changes nothing."""
        body_bottom = -(_TCP_Z_M - _BODY_LENGTH_M)
        lance, body, cup = _LANCE_RADIUS_M, _BODY_RADIUS_M, CUP_RADIUS_M
        return np.array(
            [
                [[-cup, -cup, -0.010], [cup, cup, 0.0]],
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
        data.ctrl[model.actuator(self.actuators[0]).id] = 0.0

    def grip(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Switch the vacuum on if the lip seals now; otherwise it stays off (call again while pressing)."""
        data.ctrl[model.actuator(self.actuators[0]).id] = 0.0 if self.sealed_body(model, data) is None else 1.0

    def maintain(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Drop the vacuum where the seal is lost."""
        actuator = model.actuator(self.actuators[0]).id
        if data.ctrl[actuator] > 0 and self.sealed_body(model, data) is None:
            data.ctrl[actuator] = 0.0

    def opening_m(self, model: mujoco.MjModel, data: mujoco.MjData) -> float:
        """Return 0: a cup does not open."""
        return 0.0

    def held_bodies(self, model: mujoco.MjModel, data: mujoco.MjData) -> tuple[int, ...]:
        """Return the id of the body under vacuum, if there is one."""
        body = self.sealed_body(model, data)
        on = data.ctrl[model.actuator(self.actuators[0]).id] > 0
        return (body,) if on and body is not None else ()

    def contact_force_n(self, model: mujoco.MjModel, data: mujoco.MjData) -> float:
        """Return the largest normal force on any contact of the gripper."""
        return largest_contact_force_n(model, data, self.prefix)

    def sealed_body(self, model: mujoco.MjModel, data: mujoco.MjData) -> int | None:
        """Return the id of the body on which the lip seals, or None where it leaks."""
        segments = {model.geom(name).id: k for k, name in enumerate(self.contact_geoms)}
        touched: dict[int, set[int]] = {}
        for a, b in data.contact.geom[: data.ncon]:
            for lip, other in ((int(a), int(b)), (int(b), int(a))):
                if lip in segments:
                    touched.setdefault(int(model.geom_bodyid[other]), set()).add(segments[lip])
        sealed = [body for body, lips in touched.items() if len(lips) >= _SEALING_SEGMENTS]
        if not sealed or not self._is_closed(model, data, sealed[0]):
            return None
        return sealed[0]

    def _is_closed(self, model: mujoco.MjModel, data: mujoco.MjData, body: int) -> bool:
        """Return whether rays from inside the cup meet `body` within the cup's depth: no hole under it."""
        cup = data.body(f"{self.prefix}cup")
        R_world_cup = cup.xmat.reshape(3, 3)
        groups = np.zeros(mujoco.mjNGROUP, np.uint8)
        groups[COLLISION_GROUP] = 1
        hit = np.zeros(1, np.int32)
        for offset in _INNER_POINTS_M:
            origin = cup.xpos + R_world_cup @ (offset - np.array([0, 0, CUP_DEPTH_M]))
            distance = mujoco.mj_ray(model, data, origin, R_world_cup[:, 2].copy(), groups, 1, cup.id, hit, None)
            if distance < 0 or distance > 2 * CUP_DEPTH_M or model.geom_bodyid[hit[0]] != body:
                return False
        return True


_RING = np.stack(
    [np.cos(np.arange(_SEGMENTS) * 2 * np.pi / _SEGMENTS), np.sin(np.arange(_SEGMENTS) * 2 * np.pi / _SEGMENTS)], -1
)
_INNER_POINTS_M = np.concatenate([np.zeros((1, 3)), np.pad(0.6 * CUP_RADIUS_M * _RING[::2], ((0, 0), (0, 1)))])


def add_suction_gripper(
    spec: mujoco.MjSpec, parent: mujoco.MjsSite | mujoco.MjsBody, prefix: str = "gripper/"
) -> SuctionGripper:
    """Add the suction cup at `parent` (the flange's site, or any body for a floating one) and return its handle.

    The parent's +z points away from the arm.
    """
    gripper = SuctionGripper(prefix)
    base = parent_body(spec, parent, f"{prefix}base")
    steel, shell, rubber = [0.62, 0.63, 0.65, 1.0], [0.16, 0.17, 0.18, 1.0], [0.75, 0.33, 0.12, 1.0]
    _cylinder(base, f"{prefix}adapter", 0.034, 0.0, 0.018, steel, 0.15)
    _cylinder(base, f"{prefix}body", _BODY_RADIUS_M, 0.018, _BODY_LENGTH_M, shell, 0.35)
    band = _cylinder(base, f"{prefix}band", _BODY_RADIUS_M + 0.0005, 0.048, 0.055, [0.05, 0.35, 0.62, 1.0], 0.0)
    band.contype = band.conaffinity = 0
    base.add_site(name=f"{prefix}tcp", pos=[0, 0, _TCP_Z_M], size=[0.003, 0.003, 0.003], group=4)

    # The plunger's origin is the lip's centre; the preload holds it against its stop until something pushes.
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
    # The lance ends inside the bellows, behind the lip's reach, so that only the lip touches the part.
    _cylinder(plunger, f"{prefix}lance", _LANCE_RADIUS_M, _BODY_LENGTH_M - _TCP_Z_M, -0.010, steel, 0.06)

    cup = plunger.add_body(name=f"{prefix}cup", gravcomp=1)
    for axis, name in (([1, 0, 0], "tilt_x"), ([0, 1, 0], "tilt_y")):
        cup.add_joint(
            name=f"{prefix}{name}",
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=axis,
            pos=[0, 0, -0.010],
            range=[-_TILT_LIMIT_RAD, _TILT_LIMIT_RAD],
            limited=True,
            stiffness=_TILT_STIFFNESS_NM_PER_RAD,
            damping=0.006,
            armature=2e-5,
        )
    for k, (radius, top, bottom) in enumerate(
        ((0.0058, -0.0105, -0.0085), (0.0045, -0.0085, -0.007), (0.0064, -0.007, -0.005), (0.005, -0.005, -0.0035))
    ):
        _rubber(_cylinder(cup, f"{prefix}bellows_{k}", radius, top, bottom, rubber, 0.002))
    _rubber(_cylinder(cup, f"{prefix}lip", CUP_RADIUS_M, -0.0035, -0.0004, rubber, 0.002))
    for k, (x, y) in enumerate(_RING * (CUP_RADIUS_M - _SEGMENT_RADIUS_M)):
        segment = cup.add_geom(
            name=f"{prefix}lip_{k}",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[_SEGMENT_RADIUS_M, 0, 0],
            pos=[x, y, -_SEGMENT_RADIUS_M],
            group=COLLISION_GROUP,
        )
        segment.mass = 0.001
        # Contacts within the gap carry vacuum without touching: the lip's rubber stretches that far.
        segment.gap = LIP_REACH_M
        segment.priority = 1
        segment.condim = 4
        segment.friction = [1.0, 0.002, 0.0001]
        segment.solref = [0.008, 1.0]

    for one, other in (("base", "plunger"), ("base", "cup"), ("plunger", "cup")):
        spec.add_exclude(bodyname1=f"{prefix}{one}", bodyname2=f"{prefix}{other}")
    vacuum = spec.add_actuator(name=f"{prefix}vacuum", trntype=mujoco.mjtTrn.mjTRN_BODY, target=f"{prefix}cup")
    vacuum.set_to_adhesion(gain=CUP_FORCE_N)
    vacuum.ctrllimited = True
    vacuum.ctrlrange = [0.0, 1.0]
    return gripper


def _cylinder(
    body, name: str, radius: float, z_from: float, z_to: float, rgba: list[float], mass: float
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


def _rubber(geom: mujoco.MjsGeom) -> None:
    """Make a geom of the cup visual: contacts are the lip segments' alone, for the vacuum acts on every contact."""
    geom.contype = geom.conaffinity = 0
