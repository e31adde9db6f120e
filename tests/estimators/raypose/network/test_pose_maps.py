"""Pose maps: exact both ways, differentiable, and steadier the more cells there are."""

import math

import pytest
import torch

from simpick.estimators.raypose.network.pose_maps import (
    ViewPoses,
    canonical_rays,
    cell_centres,
    decode_pose_maps,
    decode_rotation,
    encode_offsets,
    encode_pose_maps,
    encode_rotation,
)
from simpick.geometry.torch_rotations import random_rotations, rotation_angle
from tests.estimators.raypose.networks import random_views


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.mark.parametrize("cells", [2, 3, 6, 16])
@pytest.mark.parametrize("padding", [1.0, 1.2, 2.0])
def test_decoding_gives_back_the_pose(cells: int, padding: float) -> None:
    g = generator(cells)
    query, reference = (random_views((200,), g, torch.float64) for _ in range(2))
    maps = encode_pose_maps(query, reference, cells, padding)
    decoded = decode_pose_maps(maps, reference, padding)
    torch.testing.assert_close(decoded.R, query.R, atol=1e-12, rtol=0)
    torch.testing.assert_close(decoded.centre, query.centre, atol=1e-12, rtol=0)
    torch.testing.assert_close(decoded.half_extent_at_depth_m, query.half_extent_at_depth_m, atol=0, rtol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, math.pi - 1e-9, math.pi])
def test_rotations_near_the_identity_and_half_turns_are_exact_too(angle: float) -> None:
    c, s = math.cos(angle), math.sin(angle)
    R = torch.tensor([[c, -s, 0], [s, c, 0], [0, 0, 1]], dtype=torch.float64)
    for turned in (R, R[[2, 0, 1]][:, [2, 0, 1]]):
        torch.testing.assert_close(decode_rotation(encode_rotation(turned, 6)), turned, atol=1e-12, rtol=0)


def test_a_view_gives_back_its_pose_and_projects_the_origin() -> None:
    g = generator()
    T = torch.eye(4, dtype=torch.float64).repeat(50, 1, 1)
    T[:, :3, :3] = random_rotations((50,), g, torch.float64)
    T[:, :3, 3] = torch.rand((50, 3), generator=g, dtype=torch.float64) * 0.2 + torch.tensor([-0.1, -0.1, 0.4])
    half_tangent = 0.05 + 0.1 * torch.rand(50, generator=g, dtype=torch.float64)
    view = ViewPoses.of(T, half_tangent)
    torch.testing.assert_close(view.pose(half_tangent), T)
    # A crop of 100 px with this angle projects the origin to 50 + 50 centre.
    focal = 50 / half_tangent
    pixels = focal[:, None] * T[:, :2, 3] / T[:, 2:3, 3] + 50
    torch.testing.assert_close(50 + 50 * view.centre, pixels)
    torch.testing.assert_close(view.half_extent_at_depth_m, T[:, 2, 3] * 50 / focal)


def test_one_query_is_encoded_relative_to_many_references() -> None:
    g = generator()
    query, references = random_views((4, 1), g, torch.float64), random_views((4, 5), g, torch.float64)
    maps = encode_pose_maps(query, references, 3, 1.2)
    assert maps.shape == (4, 5, 3, 3, 6)
    decoded = decode_pose_maps(maps, references, 1.2)
    torch.testing.assert_close(decoded.R, query.R.expand(4, 5, 3, 3))
    torch.testing.assert_close(decoded.centre, query.centre.expand(4, 5, 2))


def test_channels_are_what_the_paper_says() -> None:
    query = ViewPoses(torch.eye(3), torch.tensor([0.5, -0.25]), torch.tensor(0.06))
    turn = torch.tensor([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    reference = ViewPoses(turn, torch.zeros(2), torch.tensor(0.03))
    maps = encode_pose_maps(query, reference, 2, padding=1.5)
    # R_rel = R_q R_k^T turns by -90 degrees about z; the canonical ray of row 0, column 1 is (0.5, -0.5, 1) / sqrt 1.5.
    expected = torch.tensor([-0.5, -0.5, 1.0]) / math.sqrt(1.5)
    torch.testing.assert_close(maps[0, 1, :3], expected)
    # (cell centre - projected origin) in box sides: a box is 1 / padding of the crop, which is 2 half sides wide.
    torch.testing.assert_close(maps[0, 1, 3:5], torch.tensor([0.0, -0.25]) * 1.5 / 2)
    torch.testing.assert_close(maps[..., 5], torch.full((2, 2), math.log(2.0)))


def test_cells_go_row_by_row_from_the_top_left() -> None:
    centres = cell_centres(4)
    torch.testing.assert_close(centres[0], torch.tensor([[-0.75, -0.75], [-0.25, -0.75], [0.25, -0.75], [0.75, -0.75]]))
    torch.testing.assert_close(centres[3, 0], torch.tensor([-0.75, 0.75]))
    torch.testing.assert_close(torch.linalg.vector_norm(canonical_rays(4), dim=-1), torch.ones(4, 4))
    torch.testing.assert_close(encode_offsets(centres[1, 2], 4, 1.2)[1, 2], torch.zeros(2))


def test_decoding_is_differentiable() -> None:
    g = generator()
    query, reference = random_views((2,), g, torch.float64), random_views((2,), g, torch.float64)
    maps = encode_pose_maps(query, reference, 3, 1.2)
    maps = (maps + 0.1 * torch.randn(maps.shape, generator=g, dtype=torch.float64)).requires_grad_()

    def decode(m: torch.Tensor) -> tuple[torch.Tensor, ...]:
        views = decode_pose_maps(m, reference, 1.2)
        return views.R, views.centre, views.half_extent_at_depth_m

    assert torch.autograd.gradcheck(decode, (maps,))


def test_gradients_are_finite_at_clean_maps_and_at_maps_of_zeros() -> None:
    clean = encode_rotation(torch.eye(3), 4)
    for maps in (clean, torch.zeros(4, 4, 3)):
        maps = maps.clone().requires_grad_()
        decode_rotation(maps).square().sum().backward()
        assert maps.grad is not None
        assert maps.grad.isfinite().all()


def test_noise_is_averaged_away_by_the_cells() -> None:
    g = generator()
    errors = {}
    for cells in (3, 6, 12):
        query, reference = random_views((300,), g, torch.float64), random_views((300,), g, torch.float64)
        maps = encode_pose_maps(query, reference, cells, 1.2)
        noisy = decode_pose_maps(maps + 0.3 * torch.randn(maps.shape, generator=g, dtype=torch.float64), reference, 1.2)
        turned = rotation_angle(noisy.R @ query.R.mT).square().mean().sqrt()
        moved = (noisy.centre - query.centre).square().mean().sqrt()
        scaled = (noisy.half_extent_at_depth_m / query.half_extent_at_depth_m).log().square().mean().sqrt()
        errors[cells] = torch.stack([turned, moved, scaled])
    # Means over p^2 cells: twice the side, half the error.
    for few, many in ((3, 6), (6, 12)):
        torch.testing.assert_close(
            errors[few] / errors[many], torch.full((3,), 2.0, dtype=torch.float64), rtol=0.2, atol=0
        )
    torch.testing.assert_close(errors[6][2], torch.tensor(0.3 / 6, dtype=torch.float64), rtol=0.1, atol=0)


def test_a_mirrored_map_decodes_to_a_rotation() -> None:
    mirrored = canonical_rays(5).double() * torch.tensor([-1.0, 1.0, 1.0])
    R = decode_rotation(mirrored)
    torch.testing.assert_close(torch.linalg.det(R), torch.tensor(1.0, dtype=torch.float64))
    torch.testing.assert_close(R @ R.mT, torch.eye(3, dtype=torch.float64))
