"""Pose errors against values worked out by hand, and against plain loops on random meshes."""

import numpy as np
import pytest
import trimesh

from simpick.errors import MeshError
from simpick.geometry import ContinuousSymmetry, Pinhole, SymmetryGroup, random_rotation, so3_exp, transform
from simpick.metrics import EvaluationModel, add, add_s, batch_pose_errors, mspd, mssd, pose_error
from simpick.metrics.pose_errors import bounding_spheres_overlap, sphere_projections_overlap

CAMERA = Pinhole(640, 480, 600.0, 600.0, 320.0, 240.0)
# A square plate, 40 x 40 mm: corners 20 sqrt(2) mm from its centre.
CORNERS = np.array([[0.02, 0.02, 0], [-0.02, 0.02, 0], [-0.02, -0.02, 0], [0.02, -0.02, 0]])
PLATE = EvaluationModel("plate", CORNERS, 0.04 * np.sqrt(2), SymmetryGroup())
SQUARE = EvaluationModel("square", CORNERS, 0.04 * np.sqrt(2), SymmetryGroup.cyclic(4))


def at(x: float, y: float, z: float, R: np.ndarray | None = None) -> np.ndarray:
    return transform(R, np.array([x, y, z], float))


def about_z(angle: float) -> np.ndarray:
    return so3_exp(np.array([0.0, 0.0, angle]))


TRUTH = at(0, 0, 1)


def test_a_shift_moves_every_vertex_alike() -> None:
    estimate = at(0.003, 0.004, 1.012)
    for error in (add, mssd):
        assert error(estimate, TRUTH, PLATE) == pytest.approx(0.013)
    assert add_s(estimate, TRUTH, PLATE) == pytest.approx(0.013)


def test_a_quarter_turn_of_a_square_is_an_error_only_without_its_symmetry() -> None:
    estimate = at(0, 0, 1, about_z(np.pi / 2))
    # Each corner moves along one side.
    for error in (add, mssd):
        assert error(estimate, TRUTH, PLATE) == pytest.approx(0.04)
    assert mspd(estimate, TRUTH, PLATE, CAMERA) == pytest.approx(24)
    assert add_s(estimate, TRUTH, PLATE) == pytest.approx(0, abs=1e-12)
    assert add(estimate, TRUTH, SQUARE) == pytest.approx(0.04)
    assert mssd(estimate, TRUTH, SQUARE) == pytest.approx(0, abs=1e-12)
    assert mspd(estimate, TRUTH, SQUARE, CAMERA) == pytest.approx(0, abs=1e-9)


def test_add_takes_the_mean_where_mssd_takes_the_maximum() -> None:
    lever = EvaluationModel("lever", np.array([[0.0, 0, 0], [0.1, 0, 0]]), 0.1, SymmetryGroup())
    estimate = at(0, 0, 1, about_z(np.pi / 3))
    # The tip moves by a chord of 60 degrees, the hinge not at all.
    assert mssd(estimate, TRUTH, lever) == pytest.approx(0.1)
    assert add(estimate, TRUTH, lever) == pytest.approx(0.05)


def test_add_s_measures_from_true_vertices_to_estimated_ones() -> None:
    # True vertices at 0 and 100 mm, estimated ones at 60 and 160 mm: nearest are 60 and 40 mm away.
    lever = EvaluationModel("lever", np.array([[0.0, 0, 0], [0.1, 0, 0]]), 0.1, SymmetryGroup())
    assert add_s(at(0.06, 0, 1), TRUTH, lever) == pytest.approx(0.05)


def test_mspd_of_a_lateral_shift_and_of_a_depth_shift() -> None:
    # 10 mm at 1 m with f = 600 are 6 px; a corner 20 mm off the axis is seen at 12 px, and at 8 px from 1.5 m.
    assert mspd(at(0.01, 0, 1), TRUTH, PLATE, CAMERA) == pytest.approx(6)
    assert mspd(at(0, 0, 1.5), TRUTH, PLATE, CAMERA) == pytest.approx(4 * np.sqrt(2))


def test_mspd_does_not_depend_on_where_pixel_centres_lie() -> None:
    bop = Pinhole(640, 480, 600.0, 600.0, 319.5, 239.5)
    estimate = at(0.02, -0.01, 1.1, about_z(0.3))
    assert mspd(estimate, TRUTH, PLATE, bop) == pytest.approx(mspd(estimate, TRUTH, PLATE, CAMERA))


def test_the_worst_vertex_counts_even_between_the_first_ones_tried() -> None:
    # All vertices are nearly alike but one, which sticks out too little to be among the 16 spread widest.
    rng = np.random.default_rng(0)
    ball = np.asarray(trimesh.creation.icosphere(2).vertices) * 0.05
    vertices = ball * rng.uniform(0.98, 1.0, (len(ball), 1))
    model = EvaluationModel("stone", vertices, 0.1, SymmetryGroup.cyclic(2))
    for estimate in transform(so3_exp(0.7 * rng.normal(size=(5, 3))), np.array([0.01, 0.0, 0.3])):
        truth = at(0, 0, 0.3)
        assert mspd(estimate, truth, model, CAMERA) == pytest.approx(loop_mspd(estimate, truth, model), rel=1e-9)
        assert mssd(estimate, truth, model) == pytest.approx(loop_mssd(estimate, truth, model), rel=1e-9)


def test_a_continuous_symmetry_is_cut_as_finely_as_bop_cuts_it() -> None:
    rim = np.stack([np.cos(np.arange(0, 6.28, 0.1)), np.sin(np.arange(0, 6.28, 0.1)), np.zeros(63)], -1) * 0.05
    disc = EvaluationModel("disc", rim, 0.1, SymmetryGroup.revolution())
    step = 2 * np.pi / 315
    on_step, between = (at(0, 0, 1, about_z(k * step)) for k in (7, 7.5))
    assert mssd(on_step, TRUTH, disc) == pytest.approx(0, abs=1e-12)
    assert mssd(between, TRUTH, disc) == pytest.approx(2 * 0.05 * np.sin(step / 4))


def loop_mssd(estimate: np.ndarray, truth: np.ndarray, model: EvaluationModel) -> float:
    best = np.inf
    for S in model.symmetry_transforms:
        worst = 0.0
        for x in model.vertices_m:
            h = np.append(x, 1)
            worst = max(worst, float(np.linalg.norm(estimate @ h - truth @ (S @ h))))
        best = min(best, worst)
    return best


def loop_mspd(estimate: np.ndarray, truth: np.ndarray, model: EvaluationModel) -> float:
    def pixel(h: np.ndarray) -> np.ndarray:
        u = CAMERA.K @ h[:3]
        return u[:2] / u[2]

    best = np.inf
    for S in model.symmetry_transforms:
        worst = 0.0
        for x in model.vertices_m:
            h = np.append(x, 1)
            worst = max(worst, float(np.linalg.norm(pixel(estimate @ h) - pixel(truth @ (S @ h)))))
        best = min(best, worst)
    return best


@pytest.mark.parametrize(
    "symmetries",
    [
        SymmetryGroup(),
        SymmetryGroup.cyclic(3, flips=True),
        SymmetryGroup(continuous=(ContinuousSymmetry((0.0, 0.6, 0.8), (0.01, 0.02, 0.0)),)),
    ],
    ids=["none", "dihedral", "continuous off centre"],
)
def test_batches_agree_with_plain_loops(symmetries: SymmetryGroup) -> None:
    rng = np.random.default_rng(0)
    mesh = trimesh.creation.torus(0.04, 0.012, major_sections=6, minor_sections=4)
    model = EvaluationModel("ring", np.asarray(mesh.vertices), 0.104, symmetries, max_symmetry_step=0.3)
    truths = transform(random_rotation(rng, (2,)), rng.uniform([-0.05, -0.05, 0.5], [0.05, 0.05, 0.7], (2, 3)))
    estimates = transform(
        so3_exp(rng.normal(size=(3, 3))) @ truths[0, :3, :3], truths[0, :3, 3] + 0.02 * rng.normal(size=(3, 3))
    )
    surface = mssd(estimates[:, None], truths[None], model)
    pixels = mspd(estimates[:, None], truths[None], model, CAMERA)
    assert surface.shape == pixels.shape == (3, 2)
    for e in range(3):
        for g in range(2):
            assert surface[e, g] == pytest.approx(loop_mssd(estimates[e], truths[g], model), rel=1e-9)
            assert pixels[e, g] == pytest.approx(loop_mspd(estimates[e], truths[g], model), rel=1e-9)


def test_a_vertex_in_the_cameras_own_plane_is_an_infinite_error() -> None:
    assert mspd(at(0, 0, 0), TRUTH, PLATE, CAMERA) == np.inf
    # Here one corner is the camera's centre itself.
    assert mspd(at(-0.02, -0.02, 0), TRUTH, PLATE, CAMERA) == np.inf


def test_errors_of_one_estimate_by_hand() -> None:
    error = pose_error(at(0.003, 0.004, 1.012, about_z(np.radians(10))), TRUTH, PLATE)
    assert error.rotation_deg == pytest.approx(10)
    assert error.translation_mm == pytest.approx(13)
    assert error.lateral_mm == pytest.approx(5)
    assert error.depth_mm == pytest.approx(12)


def test_depth_error_is_signed_and_lateral_error_is_across_the_line_of_sight() -> None:
    truth = at(0.3, 0.0, 0.4)
    # 10 mm nearer along the line of sight, which is 0.6, 0, 0.8.
    error = pose_error(at(0.294, 0.0, 0.392), truth, PLATE)
    assert error.lateral_mm == pytest.approx(0, abs=1e-9)
    assert error.depth_mm == pytest.approx(-8)
    assert error.translation_mm == pytest.approx(10)


def test_rotation_error_counts_modulo_the_symmetry() -> None:
    estimate = at(0, 0, 1, about_z(np.radians(95)))
    assert pose_error(estimate, TRUTH, PLATE).rotation_deg == pytest.approx(95)
    assert pose_error(estimate, TRUTH, SQUARE).rotation_deg == pytest.approx(5)
    disc = EvaluationModel("disc", CORNERS, 0.05, SymmetryGroup.revolution())
    assert pose_error(estimate, TRUTH, disc).rotation_deg == pytest.approx(0, abs=1e-6)


def test_translation_error_follows_the_equivalent_pose() -> None:
    # The symmetry's axis is 10 mm beside the part's origin, so a half turn carries the origin 20 mm away.
    group = SymmetryGroup(ContinuousSymmetry((0.0, 0.0, 1.0), (0.01, 0.0, 0.0)).rotation(np.pi)[None])
    model = EvaluationModel("clip", CORNERS + np.array([0.01, 0, 0]), 0.06, group)
    error = pose_error(TRUTH @ group.discrete[0], TRUTH, model)
    assert error.rotation_deg == pytest.approx(0, abs=1e-6)
    assert error.translation_mm == pytest.approx(0, abs=1e-9)
    assert error.mssd_mm == pytest.approx(0, abs=1e-9)


def test_lists_of_estimates_keep_their_order() -> None:
    estimates = np.stack([at(0, 0, 1.001), at(0, 0, 1.002)])
    errors = batch_pose_errors(estimates, np.stack([TRUTH, TRUTH]), PLATE)
    assert [round(e.depth_mm, 6) for e in errors] == [1, 2]
    assert batch_pose_errors(np.zeros((0, 4, 4)), np.zeros((0, 4, 4)), PLATE) == []


def test_bounding_spheres_overlap_below_a_diameter() -> None:
    assert bounding_spheres_overlap(at(0.09, 0, 1), TRUTH, 0.1)
    assert not bounding_spheres_overlap(at(0.11, 0, 1), TRUTH, 0.1)


def test_sphere_projections_overlap_by_angle() -> None:
    # Radii of 50 mm at 1 m and at 2 m look 0.05 and 0.025 wide: together 0.075.
    assert sphere_projections_overlap(at(0.14, 0, 2), TRUTH, 0.1)
    assert not sphere_projections_overlap(at(0.16, 0, 2), TRUTH, 0.1)
    assert not sphere_projections_overlap(at(0, 0, 0), TRUTH, 0.1)


@pytest.mark.parametrize(
    ("vertices", "diameter", "message"),
    [
        (np.zeros((0, 3)), 0.1, "model 'bad' must have finite vertices, got 0 of them"),
        (np.full((2, 3), np.nan), 0.1, "must have finite vertices"),
        (CORNERS, 0.0, "the diameter of model 'bad' must be positive, got 0.0 m"),
    ],
)
def test_impossible_models_are_refused(vertices: np.ndarray, diameter: float, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        EvaluationModel("bad", vertices, diameter, SymmetryGroup())


def test_errors_of_a_batch_are_those_of_each_pair() -> None:
    rng = np.random.default_rng(0)
    shape = (2, 3)
    a, b = (transform(random_rotation(rng, shape), rng.normal((0, 0, 1), 0.02, (*shape, 3))) for _ in range(2))
    for error in (add, add_s, mssd):
        found = error(a, b, SQUARE)
        assert found.shape == shape
        for k in np.ndindex(shape):
            assert found[k] == pytest.approx(float(error(a[k], b[k], SQUARE)), rel=1e-9)
    flat = a.reshape(-1, 4, 4), b.reshape(-1, 4, 4)
    for found, E, T in zip(batch_pose_errors(*flat, SQUARE), *flat, strict=True):
        alone = pose_error(E, T, SQUARE)
        assert vars(found) == pytest.approx(vars(alone), rel=1e-9)
        assert found.mssd_mm == pytest.approx(1e3 * float(mssd(E, T, SQUARE)), rel=1e-9)


def test_projected_spheres_overlap_where_their_images_do() -> None:
    # Radii of 0.05 m at 1 m and at 2 m have images of 0.05 and 0.025: they touch where the centres' are 0.075 apart.
    near = at(0.3, 0.1, 1)
    for apart, overlap in ((0.074, True), (0.076, False)):
        far = at(2 * (0.3 + 0.6 * apart), 2 * (0.1 + 0.8 * apart), 2)
        assert bool(sphere_projections_overlap(near, far, 0.1)) is overlap
        both = sphere_projections_overlap(np.stack([near, near]), np.stack([far, near]), 0.1)
        assert both.tolist() == [overlap, True]
