"""Symmetry groups: closure, discretisation as BOP does it, and exact distances over them."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simpick.errors import ConfigError
from simpick.geometry import (
    ContinuousSymmetry,
    SymmetryGroup,
    invert,
    random_rotation,
    rotation_angle,
    so3_exp,
    transform,
)

OFF_CENTRE = SymmetryGroup(continuous=(ContinuousSymmetry((0.0, 0.6, 0.8), (0.01, 0.0, -0.02)),))
BALL = SymmetryGroup(
    continuous=(ContinuousSymmetry((1.0, 0.0, 0.0), (0.0, 0.0, 0.1)), ContinuousSymmetry((0.0, 0.0, 1.0)))
)
GROUPS = {
    "trivial": SymmetryGroup(),
    "cyclic 6": SymmetryGroup.cyclic(6),
    "dihedral 4": SymmetryGroup.cyclic(4, (0.0, 1.0, 0.0), flips=True),
    "revolution": SymmetryGroup.revolution((0.6, 0.0, 0.8)),
    "spool": SymmetryGroup.revolution(flip=True),
    "off centre": OFF_CENTRE,
    "ball": BALL,
}
ORDERS = {"trivial": 1, "cyclic 6": 6, "dihedral 4": 8, "revolution": 64, "spool": 128, "off centre": 64, "ball": 128}
each_group = pytest.mark.parametrize("group", GROUPS.values(), ids=GROUPS.keys())
seeds = st.integers(0, 2**32 - 1)


def random_pose(rng: np.random.Generator, shape: tuple[int, ...] = ()) -> np.ndarray:
    return transform(random_rotation(rng, shape), rng.normal(size=(*shape, 3)))


@pytest.mark.parametrize("name", GROUPS)
def test_group_lists_its_elements_identity_first(name: str) -> None:
    elements = GROUPS[name].transforms()
    assert len(elements) == ORDERS[name]
    np.testing.assert_allclose(elements[0], np.eye(4), atol=1e-15)


def is_closed(group: SymmetryGroup) -> bool:
    """Return whether the product of any two elements is an element; 7, a prime, hides no element behind a divisor."""
    elements = group.transforms(7)
    products = (elements[:, None] @ elements[None]).reshape(-1, 4, 4)
    nearest = group.closest_symmetry(products[:, :3, :3])
    angle = rotation_angle(np.swapaxes(nearest[:, :3, :3], -1, -2) @ products[:, :3, :3])
    moved = np.linalg.norm(nearest[:, :3, 3] - products[:, :3, 3], axis=-1)
    return bool(angle.max() <= 1e-3 and moved.max() <= 1e-5)


@each_group
def test_groups_are_closed(group: SymmetryGroup) -> None:
    assert is_closed(group)


@pytest.mark.parametrize(
    "discrete",
    [so3_exp(np.array([[0.0, 0.0, 2 * np.pi / 3]])), so3_exp(np.pi * np.eye(3)[:2])],
    ids=["third turn without its double", "two half turns without their product"],
)
def test_incomplete_lists_are_detected(discrete: np.ndarray) -> None:
    assert not is_closed(SymmetryGroup(transform(discrete)))


def test_a_flip_that_misses_the_axis_is_detected() -> None:
    shifted = transform(so3_exp(np.array([np.pi, 0.0, 0.0])), np.array([0.0, 0.01, 0.0]))[None]
    assert not is_closed(SymmetryGroup(shifted, (ContinuousSymmetry((0.0, 0.0, 1.0)),)))


def test_bop_step_gives_315_rotations() -> None:
    assert len(SymmetryGroup.revolution(flip=True).transforms_by_step(0.01)) == 2 * 315


def test_no_surface_point_moves_further_than_the_step() -> None:
    elements = SymmetryGroup.revolution().transforms_by_step(0.05)
    rim = elements[:, :3, :3] @ np.array([0.5, 0.0, 0.0])
    assert np.linalg.norm(np.diff(rim, axis=0), axis=-1).max() <= 0.05


def test_points_on_an_offset_axis_stay() -> None:
    on_axis = np.array([0.01, 0.0, -0.02, 1.0]) + 0.3 * np.array([0.0, 0.6, 0.8, 0.0])
    np.testing.assert_allclose(OFF_CENTRE.transforms(5) @ on_axis, np.tile(on_axis, (5, 1)), atol=1e-15)


@each_group
@given(seed=seeds)
def test_symmetric_poses_have_distance_zero(group: SymmetryGroup, seed: int) -> None:
    rng = np.random.default_rng(seed)
    T = random_pose(rng)
    S = group.transforms(13)[rng.integers(len(group.transforms(13)))]
    assert group.rotation_distance((T @ S)[:3, :3], T[:3, :3]) < 1e-7
    if group is not BALL:
        np.testing.assert_allclose(group.closest_equivalent(T @ S, T), T, atol=1e-12)


@each_group
@given(seed=seeds)
def test_distance_is_symmetric_invariant_and_no_larger_than_over_the_discretised_group(
    group: SymmetryGroup, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    A, B, C = random_rotation(rng, (3,))
    distance = group.rotation_distance(A, B)
    assert distance == pytest.approx(group.rotation_distance(B, A), abs=1e-9)
    assert distance == pytest.approx(group.rotation_distance(C @ A, C @ B), abs=1e-9)
    by_search = rotation_angle(A.T @ B @ group.transforms(360)[:, :3, :3]).min()
    assert distance <= by_search + 1e-9
    if group is not BALL:
        assert distance >= by_search - np.radians(0.5)


@each_group
def test_closest_equivalent_is_the_same_part_pose(group: SymmetryGroup) -> None:
    rng = np.random.default_rng(3)
    part, reference = random_pose(rng, (20,)), random_pose(rng, (20,))
    closest = group.closest_equivalent(part, reference)
    angle = rotation_angle(np.swapaxes(closest[:, :3, :3], -1, -2) @ reference[:, :3, :3])
    np.testing.assert_allclose(angle, group.rotation_distance(part[:, :3, :3], reference[:, :3, :3]), atol=1e-9)
    # What was applied on the part's side is an element of the group.
    S = invert(part) @ closest
    nearest = group.closest_symmetry(S[:, :3, :3])
    np.testing.assert_allclose(nearest, S, atol=1e-9)


def test_closest_equivalent_broadcasts_one_part_over_many_references() -> None:
    references = random_pose(np.random.default_rng(0), (4, 5))
    assert SymmetryGroup.cyclic(3).closest_equivalent(np.eye(4), references).shape == (4, 5, 4, 4)


def test_distance_about_an_axis_is_the_tilt_of_the_axis() -> None:
    tilt = so3_exp(np.array([0.3, 0.0, 0.0])) @ so3_exp(np.array([0.0, 0.0, 1.234]))
    assert SymmetryGroup.revolution().rotation_distance(tilt, np.eye(3)) == pytest.approx(0.3)


def test_a_ball_turns_about_its_centre() -> None:
    assert BALL.is_ball
    centre = np.array([0.0, 0.0, 0.1, 1.0])
    closest = BALL.closest_equivalent(random_pose(np.random.default_rng(0)), np.eye(4))
    np.testing.assert_allclose(closest[:3, :3], np.eye(3), atol=1e-12)
    moved = BALL.closest_symmetry(random_rotation(np.random.default_rng(1))) @ centre
    np.testing.assert_allclose(moved, centre, atol=1e-12)


def test_axes_are_brought_to_unit_length() -> None:
    assert ContinuousSymmetry((0.0, 0.0, 5.0)).axis == (0.0, 0.0, 1.0)


def test_a_mirror_image_is_refused() -> None:
    with pytest.raises(ConfigError, match="a mirror image is not a symmetry of a solid part"):
        SymmetryGroup(np.diag([-1.0, 1.0, 1.0, 1.0])[None])


def test_an_axis_of_zero_length_is_refused() -> None:
    with pytest.raises(ConfigError, match="finite axis that is not zero"):
        ContinuousSymmetry((0.0, 0.0, 0.0))


def test_a_step_of_zero_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"max_step must be a fraction of the diameter in \(0, 1\], got 0.0"):
        SymmetryGroup().transforms_by_step(0.0)


@pytest.mark.parametrize("order", [1, 2, 5])
def test_the_elements_of_cyclic_and_dihedral_groups(order: int) -> None:
    # Made here, not with the module, so that mutants of the functions are seen.
    turns = [so3_exp(np.array([0.0, 0.0, 2 * np.pi * k / order])) for k in range(order)]
    np.testing.assert_allclose(SymmetryGroup.cyclic(order).with_identity[:, :3, :3], turns, atol=1e-12)
    dihedral = SymmetryGroup.cyclic(order, flips=True).with_identity[:, :3, :3]
    assert len(dihedral) == 2 * order
    np.testing.assert_allclose(dihedral[:order], turns, atol=1e-12)
    for R in dihedral[order:]:
        np.testing.assert_allclose(R @ R, np.eye(3), atol=1e-12)
        np.testing.assert_allclose(R @ [0, 0, 1], [0, 0, -1], atol=1e-12)


def test_a_cyclic_group_needs_an_order() -> None:
    with pytest.raises(ConfigError, match="order of a cyclic group must be 1 or more, got 0"):
        SymmetryGroup.cyclic(0)


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.6, 0.0, 0.8), (0.9, 0.3, -0.1)])
def test_a_revolution_has_a_half_turn_only_if_asked(axis: tuple[float, float, float]) -> None:
    assert len(SymmetryGroup.revolution(axis).discrete) == 0
    (flip,) = SymmetryGroup.revolution(axis, flip=True).discrete
    np.testing.assert_allclose(flip[:3, :3] @ axis, np.negative(axis), atol=1e-12)
    np.testing.assert_allclose(flip @ flip, np.eye(4), atol=1e-12)


@pytest.mark.parametrize("shape", [(4, 4), (2, 3, 4), (1, 2, 4, 4)])
def test_discrete_symmetries_are_a_list_of_matrices(shape: tuple[int, ...]) -> None:
    with pytest.raises(ConfigError, match=r"must have shape \(n, 4, 4\), got"):
        SymmetryGroup.__post_init__(SimpleNamespace(discrete=np.zeros(shape)))  # type: ignore[arg-type]


def test_a_matrix_that_stretches_by_a_hundredth_is_no_symmetry() -> None:
    SymmetryGroup(transform(1.004 * np.eye(3))[None])
    with pytest.raises(ConfigError, match="rigid motions"):
        SymmetryGroup(transform(1.006 * np.eye(3))[None])


def test_one_reference_serves_a_batch_of_poses_and_the_other_way_round() -> None:
    rng = np.random.default_rng(0)
    group, many, one = SymmetryGroup.cyclic(6), random_pose(rng, (2, 3)), random_pose(rng)
    for a, b in ((many, one), (one, many)):
        found = group.closest_equivalent(a, b)
        assert found.shape == (2, 3, 4, 4)
        for k in np.ndindex(2, 3):
            pair = (a[k] if a is many else a, b[k] if b is many else b)
            np.testing.assert_allclose(found[k], group.closest_equivalent(*pair), atol=1e-12)
