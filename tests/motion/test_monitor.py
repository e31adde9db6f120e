"""What the arm senses, from contacts and joint angles given by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from simpick.motion import MotionConfig, monitor
from simpick.motion.monitor import Monitor
from simpick.scene import ContactGroup, Scene, SceneConfig, build_scene

CONFIG = MotionConfig()
REST = np.zeros(6)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene(SceneConfig(parts=("bushing",), count=2, randomization="none"), seed=0)


def looked(scene: Scene, monkeypatch, *looks: list[tuple[int, int, float]]) -> Monitor:
    """Return a monitor that has looked at contacts of (geom, geom, newtons), once per list."""
    watching = Monitor(scene, CONFIG)
    for contacts in looks:
        pairs = np.array([contact[:2] for contact in contacts], int).reshape(-1, 2)
        data = SimpleNamespace(ncon=len(contacts), contact=SimpleNamespace(geom=pairs))
        monkeypatch.setattr(watching, "_scene", SimpleNamespace(data=data, model=scene.model))
        monkeypatch.setattr(
            monitor, "normal_forces", lambda _, k, c=contacts: np.array([newtons for *_, newtons in c])[k]
        )
        watching.look()
    return watching


def geom(scene: Scene, group: ContactGroup) -> int:
    return int(np.flatnonzero(scene.group_of_geom == group)[0])


def pads(scene: Scene) -> list[int]:
    assert scene.gripper is not None
    return [scene.model.geom(name).id for name in scene.gripper.contact_geoms]


def test_the_peak_is_of_one_pad_and_stays(scene: Scene, monkeypatch) -> None:
    (left, right), part = pads(scene), geom(scene, ContactGroup.PART)
    grip = [(left, part, 10.0), (part, left, 5.0), (right, part, 12.0)]
    watching = looked(scene, monkeypatch, grip, [(left, part, 1.0)])
    assert watching.peak_force_n == 15.0
    assert watching.part_force_n == 1.0, "the other forces are of the last look"


def test_only_the_robot_s_own_contacts_count(scene: Scene, monkeypatch) -> None:
    arm, wall, part = (geom(scene, g) for g in (ContactGroup.ARM, ContactGroup.BIN, ContactGroup.PART))
    watching = looked(scene, monkeypatch, [(part, wall, 90.0), (wall, arm, 7.0), (arm, part, 3.0)])
    assert (watching.fixed_force_n, watching.part_force_n, watching.peak_force_n) == (7.0, 3.0, 0.0)
    assert looked(scene, monkeypatch, [(wall, arm, 7.0)], []).fixed_force_n == 0.0


def test_each_limit_stops_the_arm_and_not_before(scene: Scene) -> None:
    watching = Monitor(scene, CONFIG)
    watching.fixed_force_n, watching.part_force_n = CONFIG.collision_force_n, CONFIG.blocked_force_n
    lag = REST + CONFIG.stall_rad * np.eye(6)[2]
    assert watching.obstruction(REST, lag, holding=False) is None

    late = watching.obstruction(REST, 1.01 * lag, holding=False)
    assert late is not None and late.cause.startswith("joint 3 lagged its command by")
    watching.part_force_n += 1.0
    blocked = watching.obstruction(REST, REST, holding=False)
    assert blocked is not None and blocked.cause.startswith("parts resisted with")
    assert watching.obstruction(REST, REST, holding=True) is None, "the grip's own force"
    watching.fixed_force_n += 1.0
    for holding in (False, True):
        pressed = watching.obstruction(REST, REST, holding=holding)
        assert pressed is not None and "pressed on" in pressed.cause


def test_a_part_is_lost_after_four_periods_without_it(scene: Scene, monkeypatch) -> None:
    watching = Monitor(scene, CONFIG)
    held = iter([(0,), (), (), (), (0, 1), (), (1,), (), ()])
    monkeypatch.setattr(watching, "held", lambda: next(held))
    # A part that is held again starts the count again; another part that is held does not.
    assert [watching.lost((0,)) for _ in range(9)] == [False] * 8 + [True]


def test_speeds_are_those_of_the_rim(scene: Scene) -> None:
    first, second = scene.instances
    before = scene.data.qvel.copy()
    scene.data.qvel[:] = 0.0
    scene.data.qvel[first.dof_adr : first.dof_adr + 3] = [0.3, 0.4, 0.0]
    scene.data.qvel[second.dof_adr + 5] = 2.0
    watching = Monitor(scene, CONFIG)
    np.testing.assert_allclose(watching.part_speeds(), [0.5, second.part.diameter_m])
    assert not watching.still(0.4)
    assert watching.still(1.0)
    scene.data.qvel[:] = before
