from itertools import pairwise

import numpy as np
import pytest

from simpick.assets import get_part, library_part_names
from simpick.errors import UnknownNameError
from simpick.geometry.transforms import transform
from simpick.grasping import verified_grasps
from simpick.grasping.store import cached_path, load_file, load_grasps, save_grasps, shipped_path
from simpick.grasping.verification import GraspBench, verified
from simpick.records import Grasp


@pytest.fixture(scope="module")
def bench() -> GraspBench:
    return GraspBench(get_part("hex_nut"), "jaw")


def side_grasp(offset_m: tuple[float, float, float], width_m: float = 0.032) -> Grasp:
    """Return a grasp over the nut's flats, from above, with the TCP displaced from the nut's centre."""
    R = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    return Grasp(transform(R, np.array(offset_m, float)), width_m, 1.0)


def test_a_good_grasp_holds(bench: GraspBench) -> None:
    assert bench.holds(side_grasp((0, 0, 0))) > 0.9


def test_a_grasp_beside_the_part_does_not_hold(bench: GraspBench) -> None:
    assert bench.holds(side_grasp((0.05, 0, 0))) == 0


def test_a_grasp_by_the_last_corner_does_not_hold(bench: GraspBench) -> None:
    assert bench.holds(side_grasp((0.0265, 0, 0.014))) == 0


def test_a_gripper_that_starts_inside_the_part_does_not_hold(bench: GraspBench) -> None:
    assert bench.holds(side_grasp((0, 0.02, 0), width_m=0.02)) == 0


def test_the_same_trial_gives_the_same_answer(bench: GraspBench) -> None:
    assert bench.holds(side_grasp((0.004, 0, 0))) == bench.holds(side_grasp((0.004, 0, 0)))


def test_verification_sorts_out_and_orders() -> None:
    grasps = [side_grasp((0.05, 0, 0)), side_grasp((0.008, 0, 0)), side_grasp((0, 0, 0))]
    kept = verified(
        get_part("hex_nut"),
        [Grasp(g.T_part_tcp, g.width_m, q) for g, q in zip(grasps, (1.0, 0.5, 0.9), strict=True)],
        "jaw",
    )
    assert len(kept) == 2
    assert kept[0].quality > kept[1].quality
    assert np.allclose(kept[0].T_part_tcp, grasps[2].T_part_tcp)


def test_verification_ends_when_enough_hold() -> None:
    offsets = (0.05, 0.0, 0.002, 0.004, 0.006)
    grasps = [side_grasp((x, 0, 0)) for x in offsets]
    everything = verified(get_part("hex_nut"), grasps, "jaw")
    few = verified(get_part("hex_nut"), grasps, "jaw", enough=2)
    assert len(everything) == 4 and {g.T_part_tcp[0, 3] for g in few} == {0.0, 0.002}
    assert all(any(a.quality == b.quality for b in everything) for a in few)


def test_verification_says_how_far_it_is() -> None:
    grasps = [side_grasp((x, 0, 0)) for x in (0.05, 0.0, 0.002, 0.004, 0.006)]
    shares: list[float] = []
    verified(get_part("hex_nut"), grasps, "jaw", on_share=shares.append)
    assert shares == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0])
    shares.clear()
    verified(get_part("hex_nut"), grasps, "jaw", enough=2, on_share=shares.append)
    assert shares == pytest.approx([0.2, 0.5, 1.0]), "ends where enough hold"


def test_an_unknown_gripper_is_refused() -> None:
    with pytest.raises(UnknownNameError, match=r"no gripper named 'hook'\. Valid: jaw, suction"):
        GraspBench(get_part("hex_nut"), "hook")


@pytest.mark.parametrize("kind", ["jaw", "suction"])
def test_every_library_part_ships_with_grasps_that_fit_it(kind: str) -> None:
    """A failure says that parts, grippers or sampling changed: run ``simpick grasps build``."""
    for name in library_part_names():
        part = get_part(name)
        grasps = load_file(shipped_path(name, kind), part, kind)
        assert grasps is not None and len(grasps) >= 5, f"{name} {kind}: run simpick grasps build"
        assert all(a.quality >= b.quality for a, b in pairwise(grasps))


@pytest.mark.parametrize(("name", "kind"), [("crane_hook", "jaw"), ("sensor_housing", "suction")])
def test_shipped_grasps_still_hold(name: str, kind: str) -> None:
    part = get_part(name)
    bench = GraspBench(part, kind)
    assert all(bench.holds(grasp) > 0 for grasp in verified_grasps(part, kind)[:4])


def test_stored_grasps_come_back_and_only_to_their_own_part(tmp_path) -> None:
    part, other = get_part("hex_nut"), get_part("bushing")
    grasps = [side_grasp((0, 0, 0)), side_grasp((0.003, 0, 0.001))]
    path = tmp_path / "grasps.npz"
    save_grasps(path, part, "jaw", grasps)
    for stored, grasp in zip(load_file(path, part, "jaw") or [], grasps, strict=True):
        np.testing.assert_allclose(stored.T_part_tcp, grasp.T_part_tcp, atol=1e-6)
        assert stored.width_m == pytest.approx(grasp.width_m)
    assert load_file(path, other, "jaw") is None
    assert load_file(path, part, "suction") is None


def test_a_damaged_file_is_as_good_as_none(tmp_path) -> None:
    path = tmp_path / "grasps.npz"
    part = get_part("hex_nut")
    whole = shipped_path("hex_nut", "jaw").read_bytes()
    for damaged in (
        b"",
        b"PK\x03\x04 not a zip file",
        whole[: len(whole) // 2],
        whole[:400] + bytes(200) + whole[600:],
    ):
        path.write_bytes(damaged)
        assert load_file(path, part, "jaw") is None


def test_a_part_that_does_not_ship_is_cached(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("SIMPICK_CACHE", str(tmp_path))
    monkeypatch.setattr("simpick.grasping.store.shipped_path", lambda name, kind: tmp_path / "none.npz")
    part = get_part("bushing")
    assert load_grasps(part, "suction") is None
    first = verified_grasps(part, "suction")
    assert first and cached_path(part, "suction").exists()
    for a, b in zip(first, verified_grasps(part, "suction"), strict=True):
        np.testing.assert_array_equal(a.T_part_tcp, b.T_part_tcp)
