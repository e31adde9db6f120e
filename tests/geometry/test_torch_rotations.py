"""Torch rotations agree with numpy's, and their gradients are right and finite where formulas usually break."""

import numpy as np
import pytest
import torch

from simpick.geometry import torch_rotations as tr
from simpick.geometry import transforms

ANGLES = [0.0, 1e-9, 1e-4, 0.03, 0.032, 1.0, 3.0, np.pi - 1e-3, np.pi - 1e-6]
AXIS = np.array([1 / 3, 2 / 3, -2 / 3])


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def random_double(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(shape, generator=generator(seed), dtype=torch.float64)


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_and_angle_agree_with_numpy(angle: float) -> None:
    w = angle * AXIS
    R = tr.so3_exp(torch.from_numpy(w))
    np.testing.assert_allclose(R.numpy(), transforms.so3_exp(w), atol=1e-12)
    np.testing.assert_allclose(tr.rotation_angle(R).numpy(), angle, atol=1e-9)


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_and_angle_gradients_are_exact(angle: float) -> None:
    w = torch.from_numpy(angle * AXIS).requires_grad_()
    assert torch.autograd.gradcheck(tr.so3_exp, w)
    if angle > 1e-6:
        assert torch.autograd.gradcheck(lambda v: tr.rotation_angle(tr.so3_exp(v)), w, eps=1e-8, atol=1e-5)


@pytest.mark.parametrize("function", [tr.so3_exp, tr.rotation_angle, tr.project_to_so3])
def test_gradients_at_the_identity_are_finite(function) -> None:
    x = (torch.zeros(3) if function is tr.so3_exp else torch.eye(3)).requires_grad_()
    function(x).sum().backward()
    assert x.grad is not None and torch.isfinite(x.grad).all()


def test_projection_is_the_nearest_rotation() -> None:
    M = random_double(50, 3, 3)
    R = tr.project_to_so3(M)
    torch.testing.assert_close(R @ R.mT, torch.eye(3, dtype=torch.float64).expand_as(R))
    torch.testing.assert_close(torch.linalg.det(R), torch.ones(50, dtype=torch.float64))
    others = R[:, None] @ tr.so3_exp(0.1 * random_double(50, 20, 3, seed=1))
    distance = ((M[:, None] - others) ** 2).sum((-1, -2))
    assert (distance >= ((M - R) ** 2).sum((-1, -2))[:, None]).all()


def test_projection_keeps_rotations() -> None:
    R = tr.random_rotations((20,), generator(), torch.float64)
    torch.testing.assert_close(tr.project_to_so3(R), R)


@pytest.mark.parametrize("determinant", [1, -1])
def test_projection_gradients_are_exact_on_both_sides_of_zero_determinant(determinant: int) -> None:
    M = random_double(6, 3, 3)
    M = M * (determinant * torch.linalg.det(M).sign())[:, None, None]
    assert torch.autograd.gradcheck(tr.project_to_so3, M.requires_grad_())


def test_projection_gradients_are_exact_where_singular_values_coincide() -> None:
    R = tr.random_rotations((3,), generator(), torch.float64).requires_grad_()
    assert torch.autograd.gradcheck(tr.project_to_so3, R)


def test_projection_of_a_reflection_has_finite_gradients() -> None:
    M = torch.diag(torch.tensor([1.0, 1.0, -1.0])).requires_grad_()
    (tr.project_to_so3(M) * torch.arange(9.0).reshape(3, 3)).sum().backward()
    assert M.grad is not None and torch.isfinite(M.grad).all()


def test_kabsch_recovers_the_rotation_between_ray_maps() -> None:
    R = tr.random_rotations((4,), generator())
    source = torch.nn.functional.normalize(torch.randn(4, 64, 3, generator=generator(1)), dim=-1)
    found = tr.kabsch(source, source @ R.mT)
    assert found.dtype == torch.float32
    torch.testing.assert_close(found, R, atol=1e-6, rtol=0)


def test_kabsch_weights_silence_outliers() -> None:
    R = tr.random_rotations((), generator())
    source = torch.randn(64, 3, generator=generator(1))
    target = source @ R.mT
    target[:20] = 10 * torch.randn(20, 3, generator=generator(2))
    weights = torch.ones(64)
    weights[:20] = 0
    torch.testing.assert_close(tr.kabsch(source, target, weights), R, atol=1e-6, rtol=0)
    assert tr.rotation_angle(tr.kabsch(source, target).mT @ R) > 0.01


def test_random_rotations_follow_their_generator() -> None:
    first = tr.random_rotations((2, 3), generator(5))
    assert first.shape == (2, 3, 3, 3)
    torch.testing.assert_close(tr.random_rotations((2, 3), generator(5)), first)
    assert not torch.equal(tr.random_rotations((2, 3), generator(6)), first)


def test_rotation_angle_of_single_precision_rotations() -> None:
    angles = torch.tensor([0.0, 0.1, 1.5, 3.1])
    R = tr.so3_exp(angles[:, None] * torch.from_numpy(AXIS).float())
    torch.testing.assert_close(tr.rotation_angle(R), angles, atol=2e-6, rtol=0)
