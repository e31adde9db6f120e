import mujoco
import numpy as np
import pytest

from simpick.assets.grippers import JAW_STROKE_M, SuctionGripper, get_gripper
from simpick.assets.grippers.jaw import JAW_FORCE_N
from simpick.assets.grippers.suction_shape import CELL_CENTRES_M, CELL_FORCE_N, CELLS, SUCTION_RADIUS_M
from simpick.scene import SceneConfig, build_scene
from simpick.scene.physics import PhysicsConfig, apply_physics


class Bench:
    """A floating gripper that points down over one free box, without gravity."""

    def __init__(self, gripper: str, half_m: tuple[float, float, float], density: float = 1200.0) -> None:
        spec = mujoco.MjSpec()
        apply_physics(spec, PhysicsConfig(sleep=False))
        mount = spec.worldbody.add_body(name="mount", pos=[0, 0, 0.5], quat=[0, 1, 0, 0])
        self.gripper = get_gripper(gripper)
        self.gripper.add(spec, mount)
        body = spec.worldbody.add_body(name="box")
        body.add_freejoint(name="box")
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=list(half_m), density=density, group=3)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.model.opt.gravity[:] = 0
        self.gripper.reset(self.model, self.data, self.gripper.max_opening_m)
        mujoco.mj_forward(self.model, self.data)
        self.tcp = self.data.site(self.gripper.tcp_site).xpos.copy()
        self.adr = int(self.model.joint("box").qposadr[0])
        self.box = self.model.body("box").id
        self.mass_kg = float(self.model.body_mass[self.box])

    def place(self, position: np.ndarray) -> None:
        self.data.qpos[self.adr : self.adr + 3] = position
        mujoco.mj_forward(self.model, self.data)

    def run(self, seconds: float) -> None:
        for step in range(round(seconds / self.model.opt.timestep)):
            mujoco.mj_step(self.model, self.data)
            if step % 10 == 9:
                self.gripper.maintain(self.model, self.data)

    @property
    def position(self) -> np.ndarray:
        return self.data.qpos[self.adr : self.adr + 3].copy()


def jaw_on_box(offset_m: float = 0.0, half_x_m: float = 0.015) -> Bench:
    bench = Bench("jaw", (half_x_m, 0.02, 0.02))
    bench.place(bench.tcp + np.array([offset_m, 0, 0]))
    bench.gripper.grip(bench.model, bench.data)
    bench.run(0.5)
    return bench


def suction_on_box(cover_m: float, density: float = 1200.0) -> Bench:
    """Return a bench whose box reaches `cover_m` from the left rim of the suction face across it."""
    bench = Bench("suction", (0.02, 0.02, 0.01), density)
    left_of_face = bench.tcp - [SUCTION_RADIUS_M, 0, 0]
    bench.place(left_of_face + np.array([cover_m - 0.02, 0, -0.0099]))
    bench.gripper.grip(bench.model, bench.data)
    bench.run(0.1)
    return bench


def test_the_jaw_closes_on_a_part_with_its_rated_force() -> None:
    bench = jaw_on_box()
    pads = {bench.model.geom(name).id for name in bench.gripper.contact_geoms}
    force = np.zeros(6)
    total = 0.0
    for k in range(bench.data.ncon):
        if pads & set(bench.data.contact.geom[k].tolist()):
            mujoco.mj_contactForce(bench.model, bench.data, k, force)
            total += force[0]
    assert total / 2 == pytest.approx(JAW_FORCE_N, rel=0.05)
    assert bench.gripper.held_bodies(bench.model, bench.data) == (bench.box,)


def test_the_jaw_stops_at_the_parts_width() -> None:
    # The rubber gives by a few tenths of a millimetre on each side.
    bench = jaw_on_box()
    assert 0.029 < bench.gripper.opening_m(*_state(bench)) < 0.0301


def test_the_jaws_fingers_move_together_and_centre_the_part() -> None:
    bench = jaw_on_box(offset_m=0.012)
    assert abs(bench.position[0] - bench.tcp[0]) < 5e-4
    left, right = (bench.data.joint(f"gripper/{side}_slide").qpos[0] for side in ("left", "right"))
    assert abs(left - right) < 5e-4


def test_a_gripped_part_does_not_creep() -> None:
    bench = jaw_on_box()
    bench.model.opt.gravity[2] = -9.81
    bench.run(0.2)
    before = bench.position
    bench.run(1.0)
    assert np.linalg.norm(bench.position - before) < 2e-5


def test_an_empty_jaw_closes_to_nothing_and_opens_to_the_command() -> None:
    bench = Bench("jaw", (0.01, 0.01, 0.01))
    bench.place(bench.tcp + np.array([0, 0, -0.3]))
    bench.gripper.grip(bench.model, bench.data)
    bench.run(0.6)
    assert bench.gripper.opening_m(*_state(bench)) < 5e-4
    assert bench.gripper.held_bodies(*_state(bench)) == ()
    bench.gripper.release(bench.model, bench.data, 0.05)
    bench.run(0.5)
    assert bench.gripper.opening_m(*_state(bench)) == pytest.approx(0.05, abs=1e-3)


@pytest.mark.parametrize("opening_m", [0.0, 0.04, JAW_STROKE_M])
def test_the_jaws_boxes_enclose_its_solids(opening_m: float) -> None:
    bench = Bench("jaw", (0.01, 0.01, 0.01))
    bench.gripper.reset(bench.model, bench.data, opening_m)
    assert_enclosed(bench, opening_m)


def test_the_suction_heads_boxes_enclose_its_solids() -> None:
    assert_enclosed(Bench("suction", (0.01, 0.01, 0.01)), 0.0)


def test_suction_holds_a_part_under_its_whole_face() -> None:
    bench = suction_on_box(cover_m=0.02)
    assert len(SuctionGripper().covered_cells(*_state(bench))[bench.box]) == CELLS
    bench.model.opt.gravity[2] = -9.81
    bench.run(0.5)
    assert bench.gripper.held_bodies(*_state(bench)) == (bench.box,)


def test_suction_force_follows_the_covered_cells() -> None:
    """Half a face lifts a part that weighs less than its cells hold, and loses one that weighs more."""
    half = int((CELL_CENTRES_M[:, 0] < 0.001).sum())
    volume_m3 = 0.04 * 0.04 * 0.02
    for share, held in ((0.2, True), (1.3, False)):
        bench = suction_on_box(0.0105, density=share * half * CELL_FORCE_N / 9.81 / volume_m3)
        assert len(SuctionGripper().covered_cells(*_state(bench))[bench.box]) == pytest.approx(half, abs=2)
        # Pull straight down at the face's covered half, so that weight and not leverage decides.
        pull = bench.mass_kg * 9.81
        point = bench.tcp - [0.6 * SUCTION_RADIUS_M, 0, 0]
        for _ in range(200):
            bench.data.qfrc_applied[:] = 0
            mujoco.mj_applyFT(
                bench.model, bench.data, np.array([0, 0, -pull]), np.zeros(3), point, bench.box, bench.data.qfrc_applied
            )
            mujoco.mj_step(bench.model, bench.data)
            bench.gripper.maintain(bench.model, bench.data)
        assert (bench.gripper.held_bodies(*_state(bench)) == (bench.box,)) == held


def test_suction_does_not_hold_what_it_hardly_covers() -> None:
    bench = suction_on_box(cover_m=0.001)
    assert bench.gripper.held_bodies(*_state(bench)) == ()


def test_released_suction_lets_go() -> None:
    bench = suction_on_box(cover_m=0.02)
    bench.gripper.release(bench.model, bench.data, 0.0)
    bench.model.opt.gravity[2] = -9.81
    bench.run(0.2)
    assert bench.gripper.held_bodies(*_state(bench)) == () and bench.position[2] < bench.tcp[2] - 0.05


@pytest.mark.parametrize("name", ["jaw", "suction"])
def test_a_gripper_is_heavier_than_nothing_and_floats_against_gravity(name: str) -> None:
    bench = Bench(name, (0.01, 0.01, 0.01))
    bench.place(bench.tcp + np.array([0, 0, -0.3]))
    bench.model.opt.gravity[2] = -9.81
    before = bench.data.qpos[: bench.adr].copy()
    bench.run(0.3)
    assert np.abs(bench.data.qpos[: bench.adr] - before).max() < 1e-3


def assert_enclosed(bench: Bench, opening_m: float) -> None:
    """Every vertex of every colliding geom's bounding box lies in the union's hull along each axis."""
    model, data = bench.model, bench.data
    mujoco.mj_forward(model, data)
    R = data.site(bench.gripper.tcp_site).xmat.reshape(3, 3)
    boxes = bench.gripper.boxes(opening_m)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    for geom in range(model.ngeom):
        body_name = model.body(model.geom_bodyid[geom]).name
        if not body_name.startswith("gripper/") or model.geom_contype[geom] == 0:
            continue
        half = model.geom_size[geom].copy()
        kind = model.geom_type[geom]
        if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
            half = np.full(3, half[0])
        elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
            # The adapter is wider than the palm but lies inside the arm's flange.
            if model.geom(geom).name.endswith("adapter"):
                continue
            half = np.array([half[0], half[0], half[1]])
        points = (data.geom_xpos[geom] + corners * half @ data.geom_xmat[geom].reshape(3, 3).T - bench.tcp) @ R
        inside = ((points[:, None] >= boxes[:, 0] - 1e-3) & (points[:, None] <= boxes[:, 1] + 1e-3)).all(axis=-1)
        assert inside.any(axis=1).all(), model.geom(geom).name


def _state(bench: Bench) -> tuple[mujoco.MjModel, mujoco.MjData]:
    return bench.model, bench.data


def test_the_cells_of_the_suction_face_are_neighbours_in_the_model() -> None:
    bench = Bench("suction", (0.01, 0.01, 0.01))
    scene = build_scene(SceneConfig(parts=("hex_nut",), count=1, gripper="suction", randomization="none"), seed=0)
    for model in (bench.model, scene.model):
        ids = [model.geom(name).id for name in SuctionGripper.contact_geoms]
        assert ids == list(range(model.ngeom))[SuctionGripper()._cells(model)]
