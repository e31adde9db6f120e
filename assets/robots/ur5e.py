"""A six-axis arm with the UR5e's kinematics, built from primitive geoms.

The frames are Denavit-Hartenberg's (standard convention, Universal Robots' published values): joint i turns about
the z axis of body i, and `link_transform(i)` leads from there to body i + 1. The base is turned by 180 degrees about
the vertical, as in the maker's ROS description, so that at ``q[0] = 0`` the arm reaches out along the world's +x.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from simpick.assets.mjcf import COLLISION_GROUP, VISUAL_GROUP
from simpick.geometry.transforms import transform

JOINT_NAMES = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
DH_D_M = (0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996)
"""Offset along each joint's axis."""
DH_A_M = (0.0, -0.425, -0.3922, 0.0, 0.0, 0.0)
"""Length along each link's x axis."""
DH_ALPHA_RAD = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
"""Twist about each link's x axis."""
LINK_MASS_KG = (3.761, 8.058, 2.846, 1.37, 1.3, 0.365)
JOINT_RANGE_RAD = 2 * np.pi
JOINT_SPEED_LIMIT_RAD_S = np.deg2rad(180.0)
JOINT_TORQUE_LIMIT_NM = (150.0, 150.0, 150.0, 28.0, 28.0, 28.0)
SERVO_KP = (6000.0, 6000.0, 4000.0, 1500.0, 1500.0, 1000.0)
"""Position gain in Nm/rad."""
SERVO_KV = (300.0, 300.0, 200.0, 40.0, 40.0, 25.0)
"""Velocity gain in Nm s/rad, near critical damping for the inertia each joint sees with the arm half stretched."""
_LEAD_S = np.asarray(SERVO_KV) / np.asarray(SERVO_KP)
ARMATURE_KG_M2 = (0.3, 0.3, 0.3, 0.1, 0.1, 0.1)
"""Rotor inertia seen through the gear."""

T_BASE_DH = transform(np.diag([-1.0, -1.0, 1.0]))
"""Leads from the frame of joint 1 at q = 0 to the mounting plane's frame."""

HOME_QPOS = np.array([-1.30, -1.66, 1.56, 0.10 - np.pi / 2, -np.pi / 2, -1.30])
"""Tool pointing down, the flange 0.52 m above the chute, elbow up: out of the overhead camera's view of the bin."""

_LINK_RGB = (0.80, 0.81, 0.82)
_CAP_RGB = (0.36, 0.56, 0.74)
_DARK_RGB = (0.20, 0.21, 0.23)

# Centres of mass in the frame at each link's far end, as published by the maker.
_COM_FAR_M = (
    (0.0, -0.02561, 0.00193),
    (0.2125, 0.0, 0.11336),
    (0.15, 0.0, 0.0265),
    (0.0, -0.0018, 0.01634),
    (0.0, 0.0018, 0.01634),
    (0.0, 0.0, -0.001159),
)
# Length and radius of the solid cylinder whose inertia each link has, and the body axis it lies along.
_INERTIA_CYLINDER = (
    (0.18, 0.06, "z"),
    (0.54, 0.06, "x"),
    (0.48, 0.05, "x"),
    (0.12, 0.045, "z"),
    (0.12, 0.045, "z"),
    (0.05, 0.04, "z"),
)


@dataclass(frozen=True)
class _Tube:
    """One cylinder or capsule of a link, between two points of the body frame in metres."""

    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float
    look: str
    collide: bool = True
    capsule: bool = False


# Offset of upper arm and forearm along the shoulder's axis; they sum up to d4 with the wrist's.
_UPPER, _FORE = 0.138, 0.007
_TUBES: tuple[tuple[_Tube, ...], ...] = (
    (  # shoulder: turns with joint 1, carries joint 2
        _Tube((0.0, 0.0, 0.075), (0.0, 0.0, 0.1625), 0.066, "link"),
        _Tube((0.0, 0.0, 0.1625), (0.0, 0.0, 0.215), 0.063, "link"),
        _Tube((0.0, 0.0, 0.215), (0.0, 0.0, 0.2225), 0.056, "cap", collide=False),
        _Tube((0.0, -0.0755, 0.1625), (0.0, 0.070, 0.1625), 0.058, "link"),
        _Tube((0.0, 0.070, 0.1625), (0.0, 0.078, 0.1625), 0.052, "cap", collide=False),
    ),
    (  # upper arm
        _Tube((0.0, 0.0, 0.077), (0.0, 0.0, 0.195), 0.060, "link"),
        _Tube((0.0, 0.0, 0.195), (0.0, 0.0, 0.203), 0.054, "cap", collide=False),
        _Tube((-0.03, 0.0, _UPPER), (-0.395, 0.0, _UPPER), 0.047, "link", capsule=True),
        _Tube((-0.425, 0.0, 0.075), (-0.425, 0.0, 0.190), 0.054, "link"),
        _Tube((-0.425, 0.0, 0.190), (-0.425, 0.0, 0.198), 0.048, "cap", collide=False),
    ),
    (  # forearm
        _Tube((0.0, 0.0, -0.048), (0.0, 0.0, 0.0735), 0.052, "link"),
        _Tube((0.0, 0.0, -0.056), (0.0, 0.0, -0.048), 0.046, "cap", collide=False),
        _Tube((-0.03, 0.0, _FORE), (-0.36, 0.0, _FORE), 0.040, "link", capsule=True),
        _Tube((-0.3922, 0.0, -0.035), (-0.3922, 0.0, 0.062), 0.043, "link"),
        _Tube((-0.3922, 0.0, -0.043), (-0.3922, 0.0, -0.035), 0.038, "cap", collide=False),
    ),
    (  # wrist 1
        _Tube((0.0, 0.0, 0.063), (0.0, 0.0, 0.171), 0.041, "link"),
        _Tube((0.0, 0.0, 0.171), (0.0, 0.0, 0.179), 0.036, "cap", collide=False),
        _Tube((0.0, -0.052, 0.1333), (0.0, 0.020, 0.1333), 0.041, "link"),
    ),
    (  # wrist 2
        _Tube((0.0, 0.0, 0.053), (0.0, 0.0, 0.138), 0.041, "link"),
        _Tube((0.0, 0.0, 0.138), (0.0, 0.0, 0.146), 0.036, "cap", collide=False),
        _Tube((0.0, 0.052, 0.0997), (0.0, -0.020, 0.0997), 0.041, "link"),
    ),
    (  # wrist 3, ends at the flange
        _Tube((0.0, 0.0, 0.0535), (0.0, 0.0, 0.0896), 0.0375, "link"),
        _Tube((0.0, 0.0, 0.0896), (0.0, 0.0, 0.0996), 0.0315, "dark"),
    ),
)


def link_transform(joint: int) -> Float[np.ndarray, "4 4"]:
    """Return the constant part Tz(d) Tx(a) Rx(alpha) of joint `joint`'s (0 to 5) Denavit-Hartenberg transform."""
    c, s = np.cos(DH_ALPHA_RAD[joint]), np.sin(DH_ALPHA_RAD[joint])
    rotation = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return transform(rotation, np.array([DH_A_M[joint], 0.0, DH_D_M[joint]]))


def add_ur5e(
    spec: mujoco.MjSpec, prefix: str = "arm/", position: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> mujoco.MjsSite:
    """Add the arm to `spec` with its mounting plane's centre at `position` and return the flange's site.

    Bodies, joints and position actuators are named `prefix` plus `JOINT_NAMES`; the base is ``base``, the site
    ``flange`` (+z out of the flange). Gravity is compensated in the arm's own links, as the maker's controller does;
    a gripper must see to itself. Command positions through `servo_command`. In contact the arm meets everything but
    itself: `simpick.motion.PickPlanner` rules out ways on which it would.
    """
    for look, rgb, specular in (("link", _LINK_RGB, 0.5), ("cap", _CAP_RGB, 0.4), ("dark", _DARK_RGB, 0.3)):
        spec.add_material(name=f"{prefix}{look}", rgba=[*rgb, 1.0], specular=specular, shininess=0.5)

    # Joint ranges are in the unit of the specification they are added to.
    reach = np.rad2deg(JOINT_RANGE_RAD) if spec.compiler.degree else JOINT_RANGE_RAD
    base = spec.worldbody.add_body(name=f"{prefix}base", pos=position, quat=[0, 0, 0, 1])
    _add_tube(base, f"{prefix}base_0", _Tube((0.0, 0.0, 0.0), (0.0, 0.0, 0.012), 0.090, "dark"), prefix)
    _add_tube(base, f"{prefix}base_1", _Tube((0.0, 0.0, 0.012), (0.0, 0.0, 0.075), 0.072, "link"), prefix)

    body = base
    T_parent_body = np.eye(4)
    for i, name in enumerate(JOINT_NAMES):
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, T_parent_body[:3, :3].ravel())
        body = body.add_body(name=prefix + name, pos=T_parent_body[:3, 3], quat=quat, gravcomp=1.0)
        T_parent_body = link_transform(i)
        body.explicitinertial = True
        body.mass = LINK_MASS_KG[i]
        body.ipos = (T_parent_body @ [*_COM_FAR_M[i], 1.0])[:3]
        body.inertia = _cylinder_inertia(LINK_MASS_KG[i], *_INERTIA_CYLINDER[i])
        joint = body.add_joint(
            name=prefix + name,
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=[0, 0, 1],
            range=[-reach, reach],
            limited=mujoco.mjtLimited.mjLIMITED_TRUE,
            armature=ARMATURE_KG_M2[i],
        )
        # The compensation is the motors' work, so it counts against their torque.
        joint.actgravcomp = True
        for k, tube in enumerate(_TUBES[i]):
            _add_tube(body, f"{prefix}{name}_{k}", tube, prefix)
        _add_servo(spec, prefix + name, i)
    return body.add_site(name=f"{prefix}flange", pos=T_parent_body[:3, 3], size=[0.005, 0.005, 0.005], group=4)


def servo_command(
    q: Float[np.ndarray, "*periods 6"], qd: Float[np.ndarray, "*periods 6"]
) -> Float[np.ndarray, "*periods 6"]:
    """Return the actuators' controls that follow position `q` (rad) moving at `qd` (rad/s) without a speed lag.

    The servo's torque is kp (ctrl - q) - kv qd; adding kv/kp times the wanted speed turns its damping into damping
    of the speed's error.
    """
    return q + _LEAD_S * qd


def _add_servo(spec: mujoco.MjSpec, name: str, i: int) -> None:
    actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_position(kp=SERVO_KP[i], kv=SERVO_KV[i])
    limit = JOINT_TORQUE_LIMIT_NM[i]
    actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
    actuator.forcerange = [-limit, limit]
    # Wider than the joint's range by what `servo_command` may add at the speed limit.
    reach = JOINT_RANGE_RAD + SERVO_KV[i] / SERVO_KP[i] * JOINT_SPEED_LIMIT_RAD_S
    actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
    actuator.ctrlrange = [-reach, reach]


def _add_tube(body: mujoco.MjsBody, name: str, tube: _Tube, prefix: str) -> None:
    kind = mujoco.mjtGeom.mjGEOM_CAPSULE if tube.capsule else mujoco.mjtGeom.mjGEOM_CYLINDER
    fromto = [float(v) for v in (*tube.start, *tube.end)]
    size = [tube.radius, 0.0, 0.0]
    body.add_geom(
        name=f"{name}/visual", type=kind, fromto=fromto, size=size, material=prefix + tube.look,
        group=VISUAL_GROUP, contype=0, conaffinity=0, mass=0.0,
    )  # fmt: skip
    if tube.collide:
        # Bits 2 and 1: meets everything of MuJoCo's default bits, but not its own links, which overlap at the joints.
        body.add_geom(
            name=f"{name}/collision", type=kind, fromto=fromto, size=size,
            group=COLLISION_GROUP, contype=2, conaffinity=1, mass=0.0, rgba=[0.8, 0.3, 0.3, 0.4],
        )  # fmt: skip


def _cylinder_inertia(mass: float, length: float, radius: float, axis: str) -> list[float]:
    along, across = mass * radius**2 / 2, mass * (3 * radius**2 + length**2) / 12
    return [along, across, across] if axis == "x" else [across, across, along]
