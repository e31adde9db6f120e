"""A two-finger parallel jaw: 85 mm stroke, 50 N, long slim fingers that reach to the floor of a 120 mm bin.

Both fingers slide on the palm and are coupled; one force-limited position servo acts on their common tendon, whose
length is the opening. The slides are damped like a worm gear's, so the jaw closes at a bounded speed for any
servo error. The pads are rubber: friction 1.1, and torsional friction that models their finite patch.
"""

from __future__ import annotations

import mujoco
import numpy as np

from simpick.assets.grippers.base import GRIPPER_PREFIX, GripperBoxes, GripperSensor, GripperServo, parent_body
from simpick.assets.grippers.hold_test import HoldTest
from simpick.assets.grippers.jaw_shape import (
    CARRIAGE_HALF_M,
    FINGER_LENGTH_M,
    FINGER_THICKNESS_M,
    JAW_STROKE_M,
    JAW_TURN_SYMMETRY,
    PAD_ABOVE_TCP_M,
    PAD_WIDTH_M,
    PALM_BOTTOM_M,
    PALM_HALF_M,
    RUBBER_M,
    TCP_Z_M,
    TIP_BEYOND_TCP_M,
    jaw_boxes,
)
from simpick.assets.grippers.sampling.antipodal import AntipodalSampling
from simpick.assets.grippers.servos import OpeningServo
from simpick.assets.mjcf import VISUAL_GROUP
from simpick.geometry.transforms import transform

JAW_FORCE_N = 50.0
"""Force of each pad when closed on a part."""

_SERVO_STIFFNESS_N_PER_M = 20_000.0
_SERVO_DAMPING_NS_PER_M = 40.0
# Past closed by more than the servo needs to saturate, so that thin parts get the full force too.
_FULL_FORCE_CONTROL = -1.5 * JAW_FORCE_N / _SERVO_STIFFNESS_N_PER_M
_SLIDE_DAMPING_NS_PER_M = 400.0
# The gear's rotor, seen at the finger. It must outweigh timestep x damping: MuJoCo solves contacts with the bare
# inertia but integrates with inertia plus timestep x damping, and stiff pads chatter where the two differ much.
_SLIDE_ARMATURE_KG = 2.0
_FINGER_MASS_KG = 0.09
_PALM_MASS_KG = 0.75


_OPENING = f"{GRIPPER_PREFIX}opening"
"""Name of the tendon whose length is the opening, and of its actuator, whose control is the commanded opening."""


class JawGripper:
    """The parallel jaw. Implements `Gripper`."""

    name = "jaw"
    tcp_site = f"{GRIPPER_PREFIX}tcp"
    T_base_tcp = transform(translation=np.array([0.0, 0.0, TCP_Z_M]))
    contact_geoms = (f"{GRIPPER_PREFIX}left_pad", f"{GRIPPER_PREFIX}right_pad")
    max_opening_m = JAW_STROKE_M
    press_m = 0.0
    turn_symmetry = JAW_TURN_SYMMETRY
    loaded_acceleration = 0.8
    sampling = AntipodalSampling()
    hold_test = HoldTest()
    sensor = GripperSensor("gripper_opening", "distance between the pads", "m", JAW_STROKE_M)

    def add(self, spec: mujoco.MjSpec, parent: mujoco.MjsSite | mujoco.MjsBody) -> None:
        """Add the jaw at `parent`, whose +z points away from the arm; the reference configuration is fully open."""
        base = parent_body(spec, parent, f"{GRIPPER_PREFIX}base")
        _add_palm(base)
        for side, sign in (("left", -1.0), ("right", 1.0)):
            _add_finger(base, side, sign)
        # Neighbours slide on one another. MuJoCo's parent filter does not cover a gripper that is fixed to the world.
        for one, other in (("left_finger", "right_finger"), ("base", "left_finger"), ("base", "right_finger")):
            spec.add_exclude(bodyname1=f"{GRIPPER_PREFIX}{one}", bodyname2=f"{GRIPPER_PREFIX}{other}")

        # The gear that couples both fingers: a part off centre moves the part or the arm, never one finger alone.
        gear = spec.add_equality(
            name=f"{GRIPPER_PREFIX}gear", type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT
        )
        gear.name1, gear.name2 = f"{GRIPPER_PREFIX}left_slide", f"{GRIPPER_PREFIX}right_slide"
        gear.data[:5] = [0.0, 1.0, 0.0, 0.0, 0.0]
        gear.solref = [0.005, 1.0]

        opening = spec.add_tendon(name=_OPENING)
        opening.wrap_joint(f"{GRIPPER_PREFIX}left_slide", 1.0)
        opening.wrap_joint(f"{GRIPPER_PREFIX}right_slide", 1.0)
        servo = spec.add_actuator(name=_OPENING, trntype=mujoco.mjtTrn.mjTRN_TENDON, target=_OPENING)
        servo.set_to_position(kp=_SERVO_STIFFNESS_N_PER_M, kv=_SERVO_DAMPING_NS_PER_M)
        servo.forcelimited = True
        servo.forcerange = [-JAW_FORCE_N, JAW_FORCE_N]
        servo.ctrllimited = True
        servo.ctrlrange = [-2 * JAW_FORCE_N / _SERVO_STIFFNESS_N_PER_M, JAW_STROKE_M]

    def boxes(self, opening_m: float) -> GripperBoxes:
        """Return boxes of both fingers, the carriages and the palm at this opening."""
        return jaw_boxes(opening_m)

    def grip_boxes(self, opening_m: float) -> GripperBoxes:
        """Return the space between the pads."""
        x, y = opening_m / 2, PAD_WIDTH_M / 2
        return np.array([[[-x, -y, -PAD_ABOVE_TCP_M], [x, y, TIP_BEYOND_TCP_M]]])

    def reset(self, model: mujoco.MjModel, data: mujoco.MjData, opening_m: float) -> None:
        """Put the fingers at this opening, at rest, and command it."""
        for side in ("left", "right"):
            joint = model.joint(f"{GRIPPER_PREFIX}{side}_slide")
            data.qpos[joint.qposadr[0]] = opening_m / 2
            data.qvel[joint.dofadr[0]] = 0.0
        self.release(model, data, opening_m)

    def release(self, model: mujoco.MjModel, data: mujoco.MjData, opening_m: float) -> None:
        """Command the jaw to this opening."""
        data.ctrl[_actuator(model)] = min(max(opening_m, 0.0), JAW_STROKE_M)

    def grip(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Command the jaw to close with its full force."""
        data.ctrl[_actuator(model)] = _FULL_FORCE_CONTROL

    def maintain(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Do nothing: a worm gear keeps its force."""

    def servo(self, model: mujoco.MjModel, data: mujoco.MjData) -> GripperServo:
        """Return a servo of the opening, which starts fully open."""
        tendon, actuator = _tendon(model), _actuator(model)
        opening_m, control = data.ten_length[tendon : tendon + 1], data.ctrl[actuator : actuator + 1]
        return OpeningServo(opening_m, control, JAW_STROKE_M, _FULL_FORCE_CONTROL)

    def sense(self, model: mujoco.MjModel, data: mujoco.MjData) -> float:
        """Return the opening within the stroke."""
        return min(max(self.opening_m(model, data), 0.0), JAW_STROKE_M)

    def opening_m(self, model: mujoco.MjModel, data: mujoco.MjData) -> float:
        """Return the distance between the pads."""
        return float(data.ten_length[_tendon(model)])

    def held_bodies(self, model: mujoco.MjModel, data: mujoco.MjData) -> tuple[int, ...]:
        """Return the movable bodies between the pads, in rising order.

        A body that presses on both pads is held. Where there is none, but each pad has a body, those in the row
        between them are.
        """
        # A loop over lists: few contacts are awake while a part is carried, and arrays of a dozen cost more.
        addresses, forces = data.contact.efc_address.tolist(), data.efc_force
        pressing: dict[int, set[int]] = {
            mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name): set() for name in self.contact_geoms
        }
        for (first, second), address in zip(data.contact.geom.tolist(), addresses, strict=True):
            if (first in pressing or second in pressing) and address >= 0 and forces[address] > 0:
                for pad, other in ((first, second), (second, first)):
                    if pad in pressing:
                        pressing[pad].add(other)
        left, right = (_movable_bodies(model, geoms) for geoms in pressing.values())
        return tuple(sorted((left & right) or (left | right if left and right else ())))

    def empty_cause(self, model: mujoco.MjModel, data: mujoco.MjData) -> str:
        """Return how far the fingers closed."""
        opening_mm = 1000 * self.opening_m(model, data)
        if opening_mm < 0.5:
            return f"fingers closed to {max(opening_mm, 0.0):.1f} mm at stage grip: nothing between the pads"
        return f"fingers stopped at {opening_mm:.1f} mm at stage grip, but no part lay between both pads"


def _movable_bodies(model: mujoco.MjModel, geoms: set[int]) -> set[int]:
    if not geoms:
        return set()
    body_of, welded_to = model.geom_bodyid, model.body_weldid
    return {body for geom in geoms if welded_to[body := int(body_of[geom])] != 0}


def _tendon(model: mujoco.MjModel) -> int:
    return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON, _OPENING)


def _actuator(model: mujoco.MjModel) -> int:
    return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, _OPENING)


def _add_palm(base: mujoco.MjsBody) -> None:
    shell = [0.16, 0.17, 0.18, 1.0]
    steel = [0.62, 0.63, 0.65, 1.0]
    px, py, pz = PALM_HALF_M
    _solid(base, f"{GRIPPER_PREFIX}palm", [px, py, pz], [0, 0, PALM_BOTTOM_M - pz], shell, _PALM_MASS_KG * 0.8)
    base.add_geom(
        name=f"{GRIPPER_PREFIX}adapter", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[0.034, 0.0105, 0],
        pos=[0, 0, 0.0105], rgba=steel, group=VISUAL_GROUP, mass=_PALM_MASS_KG * 0.2,
    )  # fmt: skip
    for name, size, pos, rgba in (
        ("rail", [px - 0.004, 0.006, 0.002], [0, 0, PALM_BOTTOM_M], steel),
        ("band", [px + 0.0005, py + 0.0005, 0.003], [0, 0, 0.034], [0.05, 0.35, 0.62, 1.0]),
    ):
        _decoration(base, f"{GRIPPER_PREFIX}{name}", size, pos, rgba)
    base.add_site(name=f"{GRIPPER_PREFIX}tcp", pos=[0, 0, TCP_Z_M], size=[0.003, 0.003, 0.003], group=4)


def _add_finger(base: mujoco.MjsBody, side: str, sign: float) -> None:
    # The body's origin is the pad's surface at the tip's height, drawn fully open.
    open_x = sign * JAW_STROKE_M / 2
    tip_z = TCP_Z_M + TIP_BEYOND_TCP_M
    finger = base.add_body(name=f"{GRIPPER_PREFIX}{side}_finger", pos=[open_x, 0, tip_z], gravcomp=1)
    finger.add_joint(
        name=f"{GRIPPER_PREFIX}{side}_slide",
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
    bar = (FINGER_THICKNESS_M - RUBBER_M) / 2
    _solid(
        finger,
        f"{GRIPPER_PREFIX}{side}_bar",
        [bar, PAD_WIDTH_M / 2 - 0.001, FINGER_LENGTH_M / 2],
        [sign * (RUBBER_M + bar), 0, -FINGER_LENGTH_M / 2],
        metal,
        _FINGER_MASS_KG * 0.7,
    )
    cx, cy, cz = CARRIAGE_HALF_M
    _solid(
        finger,
        f"{GRIPPER_PREFIX}{side}_carriage",
        [cx, cy, cz],
        [sign * (cx - 0.002), 0, -FINGER_LENGTH_M + cz],
        [0.3, 0.31, 0.33, 1.0],
        _FINGER_MASS_KG * 0.25,
    )
    pad_half = (TIP_BEYOND_TCP_M + PAD_ABOVE_TCP_M) / 2
    pad = _solid(
        finger,
        f"{GRIPPER_PREFIX}{side}_pad",
        [RUBBER_M / 2, PAD_WIDTH_M / 2, pad_half],
        [sign * RUBBER_M / 2, 0, -pad_half],
        [0.09, 0.09, 0.1, 1.0],
        _FINGER_MASS_KG * 0.05,
    )
    # Priority makes the rubber's friction apply for any part. The torsional coefficient is the mean
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
    kind = mujoco.mjtGeom.mjGEOM_BOX
    return body.add_geom(name=name, type=kind, size=half, pos=pos, rgba=rgba, group=VISUAL_GROUP, mass=mass)


def _decoration(body: mujoco.MjsBody, name: str, half: list[float], pos: list[float], rgba: list[float]) -> None:
    geom = _solid(body, name, half, pos, rgba, 0.0)
    geom.contype = geom.conaffinity = 0
