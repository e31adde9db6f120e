"""A two-finger parallel jaw: 85 mm stroke, 50 N, long slim fingers that reach to the floor of a 120 mm bin.

Both fingers slide on the palm and are coupled; one force-limited position servo acts on their common tendon, whose
length is the opening. The slides are damped like a worm gear's, so the jaw closes at a bounded speed whatever the
servo's error. The pads are rubber: friction 1.1, and torsional friction that stands for their finite patch.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from jaxtyping import Float

from simpick.assets.grippers.base import GripperBoxes, gripper_geoms, parent_body
from simpick.assets.mjcf import VISUAL_GROUP
from simpick.geometry.transforms import transform

JAW_STROKE_M = 0.085
"""Largest opening between the pads."""
JAW_FORCE_N = 50.0
"""Force of each pad when closed on a part."""
PAD_WIDTH_M = 0.020
"""Extent of a pad along y, across the closing direction."""
FINGER_THICKNESS_M = 0.0085
"""Extent of a finger along x, rubber included."""
TIP_BEYOND_TCP_M = 0.010
"""How far the fingertips reach beyond the TCP along the approach."""
PAD_ABOVE_TCP_M = 0.040
"""How far the pads reach back from the TCP, against the approach."""

_RUBBER_M = 0.002
_PALM_BOTTOM_M = 0.085
_FINGER_LENGTH_M = 0.140
_TCP_Z_M = _PALM_BOTTOM_M + _FINGER_LENGTH_M - TIP_BEYOND_TCP_M
_PALM_HALF_M = (0.062, 0.025, 0.032)
_CARRIAGE_HALF_M = (0.010, 0.014, 0.008)
_SERVO_STIFFNESS_N_PER_M = 20_000.0
_SERVO_DAMPING_NS_PER_M = 40.0
_SLIDE_DAMPING_NS_PER_M = 400.0
# The gear's rotor, felt at the finger. It must outweigh timestep x damping: MuJoCo solves contacts with the bare
# inertia but integrates with inertia plus timestep x damping, and stiff pads chatter where the two differ much.
_SLIDE_ARMATURE_KG = 2.0
_FINGER_MASS_KG = 0.09
_PALM_MASS_KG = 0.75


@dataclass(frozen=True)
class JawGripper:
    """Handle of a jaw in a model; see `Gripper` for the methods."""

    prefix: str = "gripper/"

    kind: Literal["jaw"] = "jaw"
    max_opening_m: float = JAW_STROKE_M
    press_m: float = 0.0

    @property
    def tcp_site(self) -> str:
        """Return the name of the TCP site."""
        return f"{self.prefix}tcp"

    @property
    def actuators(self) -> tuple[str, ...]:
        """Return the one actuator, whose control is the commanded opening in metres (negative: squeeze)."""
        return (f"{self.prefix}opening",)

    @property
    def contact_geoms(self) -> tuple[str, ...]:
        """Return the two pads."""
        return (f"{self.prefix}left_pad", f"{self.prefix}right_pad")

    @property
    def T_base_tcp(self) -> Float[np.ndarray, "4 4"]:
        """Return the TCP frame in the base frame."""
        return transform(translation=np.array([0.0, 0.0, _TCP_Z_M]))

    def boxes(self, opening_m: float) -> GripperBoxes:
        """Return boxes of both fingers, the carriages and the palm at this opening."""
        inner, outer = opening_m / 2, opening_m / 2 + FINGER_THICKNESS_M
        half = PAD_WIDTH_M / 2
        top = -(_FINGER_LENGTH_M - TIP_BEYOND_TCP_M)
        carriage_inner, carriage_outer = inner - 0.002, inner - 0.002 + 2 * _CARRIAGE_HALF_M[0]
        carriage_half, carriage_bottom = _CARRIAGE_HALF_M[1], top + 2 * _CARRIAGE_HALF_M[2]
        palm_x, palm_y, _ = _PALM_HALF_M
        return np.array(
            [
                [[-outer, -half, top], [-inner, half, TIP_BEYOND_TCP_M]],
                [[inner, -half, top], [outer, half, TIP_BEYOND_TCP_M]],
                [[-carriage_outer, -carriage_half, top], [-carriage_inner, carriage_half, carriage_bottom]],
                [[carriage_inner, -carriage_half, top], [carriage_outer, carriage_half, carriage_bottom]],
                [[-palm_x, -palm_y, -_TCP_Z_M], [palm_x, palm_y, top]],
            ]
        )

    def reset(self, model: mujoco.MjModel, data: mujoco.MjData, opening_m: float) -> None:
        """Put the fingers at this opening, at rest, and command it."""
        for side in ("left", "right"):
            joint = model.joint(f"{self.prefix}{side}_slide")
            data.qpos[joint.qposadr[0]] = opening_m / 2
            data.qvel[joint.dofadr[0]] = 0.0
        self.release(model, data, opening_m)

    def release(self, model: mujoco.MjModel, data: mujoco.MjData, opening_m: float) -> None:
        """Command the jaw to this opening."""
        data.ctrl[model.actuator(self.actuators[0]).id] = np.clip(opening_m, 0.0, JAW_STROKE_M)

    def grip(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Command the jaw to close with its full force."""
        # Past closed by more than the servo needs to saturate, so that thin parts feel the full force too.
        data.ctrl[model.actuator(self.actuators[0]).id] = -1.5 * JAW_FORCE_N / _SERVO_STIFFNESS_N_PER_M

    def maintain(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Do nothing: a worm gear keeps its force."""

    def opening_m(self, model: mujoco.MjModel, data: mujoco.MjData) -> float:
        """Return the distance between the pads now."""
        return float(data.ten_length[model.tendon(f"{self.prefix}opening").id])

    def held_bodies(self, model: mujoco.MjModel, data: mujoco.MjData) -> tuple[int, ...]:
        """Return ids of the bodies outside the gripper that touch both pads, in rising order."""
        ours = gripper_geoms(model, self.prefix)
        touching = []
        for name in self.contact_geoms:
            pad = model.geom(name).id
            pairs = data.contact.geom[: data.ncon]
            hits = pairs[(pairs == pad).any(axis=1)]
            others = hits[hits != pad]
            touching.append({int(model.geom_bodyid[g]) for g in others if not ours[g]})
        return tuple(sorted(touching[0] & touching[1]))


def add_jaw_gripper(
    spec: mujoco.MjSpec, parent: mujoco.MjsSite | mujoco.MjsBody, prefix: str = "gripper/"
) -> JawGripper:
    """Add the jaw at `parent` (the flange's site, or any body for a floating one) and return its handle.

    The parent's +z points away from the arm. At the model's reference configuration the jaw is fully open.
    """
    gripper = JawGripper(prefix)
    base = parent_body(spec, parent, f"{prefix}base")
    _add_palm(base, prefix)
    for side, sign in (("left", -1.0), ("right", 1.0)):
        _add_finger(base, prefix, side, sign)
    # Neighbours slide on one another. (MuJoCo's own parent filter does not cover a gripper that is fixed to the world.)
    for one, other in (("left_finger", "right_finger"), ("base", "left_finger"), ("base", "right_finger")):
        spec.add_exclude(bodyname1=f"{prefix}{one}", bodyname2=f"{prefix}{other}")

    # The gear that couples both fingers: a part off centre moves the part or the arm, never one finger alone.
    gear = spec.add_equality(name=f"{prefix}gear", type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT)
    gear.name1, gear.name2 = f"{prefix}left_slide", f"{prefix}right_slide"
    gear.data[:5] = [0.0, 1.0, 0.0, 0.0, 0.0]
    gear.solref = [0.005, 1.0]

    opening = spec.add_tendon(name=f"{prefix}opening")
    opening.wrap_joint(f"{prefix}left_slide", 1.0)
    opening.wrap_joint(f"{prefix}right_slide", 1.0)
    servo = spec.add_actuator(name=f"{prefix}opening", trntype=mujoco.mjtTrn.mjTRN_TENDON, target=f"{prefix}opening")
    servo.set_to_position(kp=_SERVO_STIFFNESS_N_PER_M, kv=_SERVO_DAMPING_NS_PER_M)
    servo.forcelimited = True
    servo.forcerange = [-JAW_FORCE_N, JAW_FORCE_N]
    servo.ctrllimited = True
    servo.ctrlrange = [-2 * JAW_FORCE_N / _SERVO_STIFFNESS_N_PER_M, JAW_STROKE_M]
    return gripper


def _add_palm(base: mujoco.MjsBody, prefix: str) -> None:
    shell = [0.16, 0.17, 0.18, 1.0]
    steel = [0.62, 0.63, 0.65, 1.0]
    px, py, pz = _PALM_HALF_M
    _solid(base, f"{prefix}palm", [px, py, pz], [0, 0, _PALM_BOTTOM_M - pz], shell, _PALM_MASS_KG * 0.8)
    adapter = base.add_geom(
        name=f"{prefix}adapter",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[0.034, 0.0105, 0],
        pos=[0, 0, 0.0105],
        rgba=steel,
        group=VISUAL_GROUP,
    )
    adapter.mass = _PALM_MASS_KG * 0.2
    for name, size, pos, rgba in (
        ("rail", [px - 0.004, 0.006, 0.002], [0, 0, _PALM_BOTTOM_M], steel),
        ("band", [px + 0.0005, py + 0.0005, 0.003], [0, 0, 0.034], [0.05, 0.35, 0.62, 1.0]),
    ):
        _decoration(base, f"{prefix}{name}", size, pos, rgba)
    base.add_site(name=f"{prefix}tcp", pos=[0, 0, _TCP_Z_M], size=[0.003, 0.003, 0.003], group=4)


def _add_finger(base: mujoco.MjsBody, prefix: str, side: str, sign: float) -> None:
    # The body's origin is the pad's surface at the tip's height, drawn fully open.
    open_x = sign * JAW_STROKE_M / 2
    tip_z = _TCP_Z_M + TIP_BEYOND_TCP_M
    finger = base.add_body(name=f"{prefix}{side}_finger", pos=[open_x, 0, tip_z], gravcomp=1)
    finger.add_joint(
        name=f"{prefix}{side}_slide",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[sign, 0, 0],
        ref=JAW_STROKE_M / 2,
        range=[0, JAW_STROKE_M / 2],
        limited=True,
        damping=_SLIDE_DAMPING_NS_PER_M,
        armature=_SLIDE_ARMATURE_KG,
        solref_limit=[0.005, 1.0],
    )
    metal = [0.55, 0.56, 0.58, 1.0]
    bar = (FINGER_THICKNESS_M - _RUBBER_M) / 2
    _solid(
        finger,
        f"{prefix}{side}_bar",
        [bar, PAD_WIDTH_M / 2 - 0.001, _FINGER_LENGTH_M / 2],
        [sign * (_RUBBER_M + bar), 0, -_FINGER_LENGTH_M / 2],
        metal,
        _FINGER_MASS_KG * 0.7,
    )
    cx, cy, cz = _CARRIAGE_HALF_M
    _solid(
        finger,
        f"{prefix}{side}_carriage",
        [cx, cy, cz],
        [sign * (cx - 0.002), 0, -_FINGER_LENGTH_M + cz],
        [0.3, 0.31, 0.33, 1.0],
        _FINGER_MASS_KG * 0.25,
    )
    pad_half = (TIP_BEYOND_TCP_M + PAD_ABOVE_TCP_M) / 2
    pad = _solid(
        finger,
        f"{prefix}{side}_pad",
        [_RUBBER_M / 2, PAD_WIDTH_M / 2, pad_half],
        [sign * _RUBBER_M / 2, 0, -pad_half],
        [0.09, 0.09, 0.1, 1.0],
        _FINGER_MASS_KG * 0.05,
    )
    # Priority makes the rubber's friction rule whatever the part's is. The torsional coefficient is the mean
    # radius of the patch (about 7 mm) times the friction; without it a part swings about its contact points.
    pad.priority = 1
    pad.condim = 4
    pad.friction = [1.1, 0.008, 0.0001]
    # A contact is as stiff as the part is heavy: with MuJoCo's default solimp, one of 20 g sinks 5 mm into the pad.
    pad.solref = [0.006, 1.0]
    pad.solimp = [0.95, 0.99, 0.001, 0.5, 2.0]


def _solid(
    body: mujoco.MjsBody, name: str, half: list[float], pos: list[float], rgba: list[float], mass: float
) -> mujoco.MjsGeom:
    geom = body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=half, pos=pos, rgba=rgba, group=VISUAL_GROUP)
    geom.mass = mass
    return geom


def _decoration(body: mujoco.MjsBody, name: str, half: list[float], pos: list[float], rgba: list[float]) -> None:
    geom = _solid(body, name, half, pos, rgba, 0.0)
    geom.contype = geom.conaffinity = 0
