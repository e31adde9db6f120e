"""Deterministic sampling with denoisers whose answers are known."""

import pytest
import torch

from simpick.errors import ConfigError
from simpick.estimators.raypose.diffusion.sampler import sample
from simpick.estimators.raypose.diffusion.schedule import make_schedule
from simpick.estimators.raypose.diffusion.x0_parameterization import add_noise, implied_noise


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("steps", [1, 2, 5, 100])
def test_a_perfect_denoiser_is_followed_exactly(steps: int) -> None:
    clean = noise(4, 3, 6, seed=1)
    sampled = sample(lambda noisy, log_snr: clean, noise(4, 3, 6), make_schedule(), steps)
    torch.testing.assert_close(sampled, clean, rtol=0, atol=0)


def test_a_perfect_denoiser_sees_maps_with_the_noise_that_it_is_given() -> None:
    clean, start, schedule = noise(2, 500, seed=1), noise(2, 500), make_schedule()
    seen: list[tuple[torch.Tensor, torch.Tensor]] = []

    def denoise(noisy: torch.Tensor, log_snr: torch.Tensor) -> torch.Tensor:
        seen.append((noisy, log_snr))
        return clean

    sample(denoise, start, schedule, 5)
    levels = torch.stack([level[0] for _, level in seen])
    torch.testing.assert_close(levels, schedule.log_snrs[schedule.sampling_steps(5)])
    # What is left of the start is the same noise at every step.
    constant = implied_noise(start, clean, seen[0][1])
    for noisy, level in seen:
        torch.testing.assert_close(noisy, add_noise(clean, constant, level), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("name", ["log_snr", "cosine", "linear"])
def test_the_best_denoiser_of_a_gaussian_keeps_its_spread(name: str) -> None:
    deviation, schedule = 0.5, make_schedule(name)
    ratios = []

    def denoise(noisy: torch.Tensor, log_snr: torch.Tensor) -> torch.Tensor:
        alpha = log_snr.sigmoid()[:, None]
        variance = alpha * deviation**2 + 1 - alpha
        ratios.append((noisy.square().mean(dim=1) / variance[:, 0]).mean().item())
        return alpha.sqrt() * deviation**2 / variance * noisy

    sample(denoise, noise(1, 20000), schedule, 100)
    assert ratios == pytest.approx([1.0] * 100, abs=0.05)


def test_sampling_is_deterministic_and_does_not_depend_on_the_place_in_the_batch() -> None:
    def denoise(noisy: torch.Tensor, log_snr: torch.Tensor) -> torch.Tensor:
        return torch.tanh(noisy * log_snr[:, None])

    start = noise(5, 7)
    kept = start.clone()
    sampled = sample(denoise, start, make_schedule(), 8)
    assert torch.equal(start, kept)
    assert torch.equal(sample(denoise, start, make_schedule(), 8), sampled)
    order = [3, 0, 4, 1, 2]
    torch.testing.assert_close(sample(denoise, start[order], make_schedule(), 8), sampled[order])
    torch.testing.assert_close(sample(denoise, start[2:3], make_schedule(), 8), sampled[2:3])


def test_too_many_steps_are_refused() -> None:
    with pytest.raises(ConfigError, match="denoising steps must be between 1 and 10, got 11"):
        sample(lambda noisy, log_snr: noisy, noise(1, 2), make_schedule(timesteps=10), 11)
