"""`Scene`: a bin of parts in simulation, and the truth about it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float, Int

from simpick.assets.contact_forces import normal_forces
from simpick.assets.grippers import Gripper, get_gripper
from simpick.assets.library import get_part
from simpick.assets.part import Part
from simpick.assets.robots.registry import Robot, get_robot
from simpick.errors import SceneError, SimulationFaultError
from simpick.geometry.pinhole import Pinhole
from simpick.geometry.transforms import transform
from simpick.records import InstanceTruth
from simpick.scene.archive import STATE, SceneArchive, read_archive, write_archive
from simpick.scene.cameras import camera_pinhole, camera_pose
from simpick.scene.composition import body_name, compose_scene, draw_parts
from simpick.scene.config import SceneConfig
from simpick.scene.contacts import ContactGroup, contacts_between, group_of_geom
from simpick.scene.parking import park, release
from simpick.scene.physics import stop_engine_log_file
from simpick.scene.robot import go_home
from simpick.scene.sleep import restore_sleep_state, sleep_state, wake_all
from simpick.scene.workspace import bin_zone, chute_zone

MAX_SPEED = 100.0
"""Any joint faster than this (m/s, the arm's rad/s) means that the physics has diverged: a part thrown across the cell
stays well below."""
MAX_SPIN = 3000.0
"""The same for the spin of a part, in rad/s: a nut that the jaw pinches at its rim leaves with some 400 rad/s."""
_FAULTS = slice(int(mujoco.mjtWarning.mjWARN_BADQPOS), int(mujoco.mjtWarning.mjWARN_BADQACC) + 1)
"""The warnings of diverged positions, speeds and accelerations, which are neighbours."""


@dataclass(frozen=True, eq=False)
class Instance:
    """One part in the scene."""

    instance: int
    """Number of the instance, from 0; body and free joint are named ``part_<number>``."""
    part: Part
    body_id: int
    qpos_adr: int
    """Its position and quaternion wxyz are ``data.qpos[qpos_adr : qpos_adr + 7]``."""
    dof_adr: int
    """Its velocity is ``data.qvel[dof_adr : dof_adr + 6]``."""


class Scene:
    """A bin of parts with arm, gripper and cameras. Make one with `build_scene` or `Scene.load`.

    All poses are as of the last kinematics; `step` and every method that moves something updates them,
    so that images, truth and contacts belong together.
    """

    def __init__(self, config: SceneConfig, seed: int, parts: Sequence[Part], model: mujoco.MjModel) -> None:
        stop_engine_log_file()
        self.config = config
        self.seed = seed
        self.model = model
        self.data = mujoco.MjData(model)
        self.robot: Robot | None = get_robot(config.robot) if config.robot is not None else None
        self.gripper: Gripper | None = get_gripper(config.gripper) if config.robot is not None else None
        self.redropped = 0
        """How many times a part had to be dropped again while the bin was filled."""
        self._removed: set[int] = set()
        self.instances: tuple[Instance, ...] = tuple(self._instance(k, part) for k, part in enumerate(parts))
        self.instance_of_geom: Int[np.ndarray, "geoms"] = np.full(model.ngeom, -1, np.int32)
        """Instance number of each geom; -1 for everything that is no part."""
        for instance in self.instances:
            self.instance_of_geom[model.geom_bodyid == instance.body_id] = instance.instance
        self._fastest = np.full(model.nv, MAX_SPEED)
        for instance in self.instances:
            self._fastest[instance.dof_adr + 3 : instance.dof_adr + 6] = MAX_SPIN
        self._speed_shares = np.zeros(model.nv)
        # MuJoCo's own memory. Parts are composed last, so theirs is the end of each array.
        data, count = self.data, len(self.instances)
        self._qpos, self._qvel, self._faults = data.qpos, data.qvel, data.warning.number[_FAULTS]
        self._part_positions_m = data.qpos[model.nq - 7 * count :].reshape(-1, 7)[:, :3]
        self._part_rotations = data.xmat[model.nbody - count :].reshape(-1, 3, 3)
        self._part_xpos = data.xpos[model.nbody - count :]
        self._identities = np.tile(np.eye(4), (count, 1, 1))
        zones = bin_zone(config.bin), chute_zone()
        self._zones_lower_m, self._zones_upper_m = (
            np.array([[zone.lower_m] for zone in zones]),
            np.array([[zone.upper_m] for zone in zones]),
        )
        self.group_of_geom: Int[np.ndarray, "geoms"] = group_of_geom(model)
        """`ContactGroup` of each geom."""

    def _instance(self, k: int, part: Part) -> Instance:
        joint = self.model.joint(body_name(k))
        return Instance(k, part, self.model.body(body_name(k)).id, int(joint.qposadr[0]), int(joint.dofadr[0]))

    # -- time ---------------------------------------------------------------------------------------------------

    @property
    def time_s(self) -> float:
        """Return the simulated time since the bin was settled."""
        return float(self.data.time)

    def step(self, steps: int = 1) -> None:
        """Simulate this many steps. Raises SimulationFaultError on divergence."""
        self.advance(steps)
        self.finish_step()

    def advance(self, steps: int = 1) -> None:
        """Simulate this many steps of several; `finish_step` follows the last, and before any pose is read."""
        mujoco.mj_step(self.model, self.data, nstep=steps)

    def finish_step(self) -> None:
        """Bring all poses up to date. Raises SimulationFaultError where the physics has diverged."""
        self.check_finite()
        self.update_kinematics()

    def update_kinematics(self) -> None:
        """Bring the poses of bodies, sites, cameras and lights up to date with the joints."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def check_finite(self) -> None:
        """Raise SimulationFaultError where the physics has diverged."""
        data, shares, qpos = self.data, self._speed_shares, self._qpos
        # A NaN is within no limit, and makes a sum of squares one.
        # Where the sum of the squared shares is below 1, so is each of them.
        np.divide(self._qvel, self._fastest, out=shares)
        slow = shares.dot(shares) <= 1.0 or (np.abs(shares) <= 1.0).all()
        if not slow or not math.isfinite(qpos.dot(qpos)) or np.count_nonzero(self._faults):
            counts = enumerate(self._faults.tolist(), start=_FAULTS.start)
            warned = [mujoco.mjtWarning(fault).name for fault, count in counts if count > 0]
            speed = np.abs(data.qvel).max(initial=0.0)
            raise SimulationFaultError(
                f"the physics diverged at {data.time:.3f} s (largest joint speed {speed:.3g}"
                f"{', ' + ', '.join(warned) if warned else ''}); the scene cannot be used further"
            )

    # -- truth --------------------------------------------------------------------------------------------------

    @property
    def positions_m(self) -> Float[np.ndarray, "instances 3"]:
        """Return where the origins of all instances are, removed ones included."""
        return self._part_positions_m.copy()

    def T_world_part(self, instance: int) -> Float[np.ndarray, "4 4"]:
        """Return the true pose of an instance."""
        body = self.instances[instance].body_id
        return transform(self.data.xmat[body].reshape(3, 3), self.data.xpos[body].copy())

    def Ts_world_part(self) -> Float[np.ndarray, "instances 4 4"]:
        """Return the true poses of all instances, removed ones included."""
        Ts_world_part = self._identities.copy()
        Ts_world_part[:, :3, :3] = self._part_rotations
        Ts_world_part[:, :3, 3] = self._part_xpos
        return Ts_world_part

    def truth(self) -> tuple[InstanceTruth, ...]:
        """Return the true pose of every instance that has not been removed."""
        inside = set(self.parts_in_bin())
        return tuple(
            InstanceTruth(i.instance, i.part.name, self.T_world_part(i.instance), i.instance in inside)
            for i in self.instances
            if i.instance not in self._removed
        )

    def parts_in_bin(self) -> tuple[int, ...]:
        """Return the instances whose centre lies in the bin, or on the pile up to 6 cm above its rim."""
        return self.parts_by_zone()[0]

    def parts_in_chute(self) -> tuple[int, ...]:
        """Return the delivered instances that still lie in the chute."""
        return self.parts_by_zone()[1]

    def parts_by_zone(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Return `parts_in_bin` and `parts_in_chute` together, which takes little longer than either."""
        at_m = self._part_positions_m
        in_bin, in_chute = ((at_m >= self._zones_lower_m) & (at_m <= self._zones_upper_m)).all(axis=-1)
        return self._where(in_bin), self._where(in_chute)

    def parts_elsewhere(self) -> tuple[int, ...]:
        """Return the instances neither in the bin nor in the chute: held, in flight, or lost on the table."""
        in_bin, in_chute = self.parts_by_zone()
        found = {*in_bin, *in_chute, *self._removed}
        return tuple(i.instance for i in self.instances if i.instance not in found)

    @property
    def removed(self) -> tuple[int, ...]:
        """Return the instances that were taken out of the scene."""
        return tuple(sorted(self._removed))

    def in_bin(self, instance: int) -> bool:
        """Return whether an instance counts as in the bin."""
        return instance in self.parts_in_bin()

    def in_chute(self, instance: int) -> bool:
        """Return whether an instance lies in the chute."""
        return instance in self.parts_in_chute()

    def _where(self, mask: np.ndarray) -> tuple[int, ...]:
        found = mask.nonzero()[0].tolist()
        return tuple(k for k in found if k not in self._removed) if self._removed else tuple(found)

    # -- cameras ------------------------------------------------------------------------------------------------

    @property
    def cameras(self) -> tuple[str, ...]:
        """Return the names of the cameras."""
        return tuple(self.model.camera(k).name for k in range(self.model.ncam))

    def camera(self, name: str) -> tuple[Pinhole, Float[np.ndarray, "4 4"]]:
        """Return a camera's intrinsics and T_world_camera (OpenCV axes); raises UnknownNameError."""
        return camera_pinhole(self.model, name), camera_pose(self.model, self.data, name)

    # -- contacts -----------------------------------------------------------------------------------------------

    def touching(self, a: ContactGroup, b: ContactGroup) -> bool:
        """Return whether any two geoms of these groups press on each other, as of the last step."""
        return self.contact_force_n(a, b) > 0

    def contact_force_n(self, a: ContactGroup, b: ContactGroup) -> float:
        """Return the largest normal force between these groups, as of the last step; 0 without contact."""
        selected = contacts_between(self.data, self.group_of_geom, a, b)
        return float(normal_forces(self.data)[selected].max(initial=0.0))

    # -- changes ------------------------------------------------------------------------------------------------

    def remove(self, instance: int) -> None:
        """Take an instance out of the cell for good: it is parked far away and counted nowhere any more."""
        if not 0 <= instance < len(self.instances):
            raise SceneError(f"instance must be between 0 and {len(self.instances) - 1}, got {instance}")
        if instance not in self._removed:
            self._removed.add(instance)
            park(self.model, self.data, body_name(instance), instance)
            wake_all(self.model, self.data)
            self.update_kinematics()

    def place(self, Ts_world_part: Mapping[int, Float[np.ndarray, "4 4"]]) -> None:
        """Place instances, at rest; removed ones return to the scene."""
        for instance, T_world_part in Ts_world_part.items():
            self._removed.discard(instance)
            release(self.model, self.data, body_name(instance), T_world_part)
        wake_all(self.model, self.data)
        self.update_kinematics()

    def go_home(self) -> None:
        """Set arm and gripper to their rest pose at once, without simulating the motion."""
        if self.robot is not None and self.gripper is not None:
            go_home(self.model, self.data, self.robot, self.gripper)
            self.update_kinematics()

    # -- files --------------------------------------------------------------------------------------------------

    def save(self, path: str | Path) -> Path:
        """Write everything to one file from which `load` continues bit for bit; raises OutputError."""
        path = Path(path)
        state = np.zeros(mujoco.mj_stateSize(self.model, STATE))
        mujoco.mj_getState(self.model, self.data, state, STATE)
        hashes = tuple(i.part.content_hash for i in self.instances)
        archive = SceneArchive(
            mujoco_version=mujoco.__version__,
            config=self.config,
            seed=self.seed,
            part_hashes=hashes,
            removed=self.removed,
            redropped=self.redropped,
            state=state,
            sleep=sleep_state(self.data),
            adhesion_n=self.model.geom_adhesion.copy(),
        )
        write_archive(path, archive)
        return path

    @staticmethod
    def load(path: str | Path) -> Scene:
        """Read a scene that `save` wrote; raises SceneError where the file, a part or MuJoCo has changed since."""
        path = Path(path)
        archive = read_archive(path)
        if archive.mujoco_version != mujoco.__version__:
            raise SceneError(
                f"{path} must be of MuJoCo {mujoco.__version__}, which is installed, got {archive.mujoco_version}:"
                " another version may store and continue the state differently; build the scene again"
            )
        config, seed = archive.config, archive.seed
        parts = draw_parts([get_part(name) for name in config.parts], config.count, seed)
        if len(archive.part_hashes) != len(parts):
            raise SceneError(
                f"{path} must hold {len(parts)} parts, as its configuration says, has {len(archive.part_hashes)}; "
                "build the scene again"
            )
        for part, expected in zip(parts, archive.part_hashes, strict=True):
            if part.content_hash != expected:
                raise SceneError(
                    f"part {part.name!r} must have the content hash {expected} of the scene in {path}, got"
                    f" {part.content_hash}: its shape, material or density has changed; build the scene again"
                )
        scene = Scene(config, seed, parts, compose_scene(config, parts, seed).compile())
        scene._check_fit(archive, path)
        scene.redropped = archive.redropped
        scene._removed = set(archive.removed)
        scene.model.geom_adhesion[:] = archive.adhesion_n
        scene._restore(archive.state, archive.sleep)
        return scene

    def _check_fit(self, archive: SceneArchive, path: Path) -> None:
        """Raise SceneError unless the archive's arrays fit the model: numpy broadcasts, and MuJoCo trusts indices."""
        model, own = self.model, sleep_state(self.data)
        expected = {"state": np.zeros(mujoco.mj_stateSize(model, STATE)), "adhesion_n": model.geom_adhesion, **own}
        found = {"state": archive.state, "adhesion_n": archive.adhesion_n, **archive.sleep}
        wrong = [name for name, array in expected.items() if not _is_like(found.get(name), array)]
        most = max(model.nbody, model.nv)
        wrong += [n for n in own if n not in wrong and own[n].dtype.kind == "i" and found[n].max(initial=0) > most]
        if wrong:
            raise SceneError(
                f"{path} does not fit the scene that it describes: {', '.join(wrong)} must have the model's length and "
                "range; build the scene again"
            )

    def _restore(self, state: Float[np.ndarray, "state"], sleep: dict[str, np.ndarray]) -> None:
        mujoco.mj_setState(self.model, self.data, state, STATE)
        # All awake, so that the poses of sleeping parts are computed too. This invalidates the warm start, hence twice.
        wake_all(self.model, self.data)
        mujoco.mj_setState(self.model, self.data, state, STATE)
        restore_sleep_state(self.data, sleep)
        self.update_kinematics()


def _is_like(array: np.ndarray | None, expected: np.ndarray) -> bool:
    return array is not None and array.shape == expected.shape and array.dtype == expected.dtype
