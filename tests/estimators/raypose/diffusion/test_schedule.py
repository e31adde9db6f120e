"""Noise schedules, and what noise levels mean."""

import pytest
import torch

from simpick.errors import ConfigError, UnknownNameError
from simpick.estimators.raypose.diffusion.schedule import SCHEDULES, Schedule, make_schedule
from simpick.estimators.raypose.diffusion.x0_parameterization import add_noise, amplitudes, implied_noise


@pytest.mark.parametrize("name", SCHEDULES)
@pytest.mark.parametrize("timesteps", [2, 100, 1000])
def test_the_signal_falls_from_step_to_step(name: str, timesteps: int) -> None:
    schedule = make_schedule(name, timesteps)
    assert len(schedule) == timesteps
    assert (schedule.log_snrs.diff() < 0).all()
    assert schedule.log_snrs.isfinite().all()


def test_log_snr_is_uniform_from_2_to_minus_9() -> None:
    levels = make_schedule().log_snrs
    assert len(levels) == 100
    assert (levels[0].item(), levels[-1].item()) == pytest.approx((2.0, -9.0))
    torch.testing.assert_close(levels.diff(), torch.full((99,), -11 / 99), rtol=1e-4, atol=1e-5)


def test_linear_and_cosine_are_the_published_ones() -> None:
    betas = torch.linspace(1e-4, 0.2, 100, dtype=torch.float64)
    torch.testing.assert_close(
        make_schedule("linear").log_snrs.double().sigmoid(), (1 - betas).cumprod(0), rtol=1e-4, atol=1e-7
    )
    alpha = make_schedule("cosine").log_snrs.sigmoid()
    assert alpha[49].item() == pytest.approx(0.4938, abs=2e-3)  # cos^2 of (0.5 + s) / (1 + s) quarter turns, s = 0.008


@pytest.mark.parametrize("count", [1, 2, 3, 5, 7, 10, 50, 67, 99, 100])
def test_sampling_begins_at_the_noisiest_step_and_never_repeats_one(count: int) -> None:
    steps = make_schedule().sampling_steps(count).tolist()
    assert len(set(steps)) == count
    assert steps == sorted(steps, reverse=True)
    assert steps[0] == 99
    assert steps[-1] >= 0
    gaps = [a - b for a, b in zip(steps, [*steps[1:], -1], strict=True)]
    assert max(gaps) - min(gaps) <= 1


def test_all_steps_can_be_taken() -> None:
    assert make_schedule().sampling_steps(100).tolist() == list(range(99, -1, -1))


@pytest.mark.parametrize("count", [0, -1, 101])
def test_a_number_of_steps_out_of_range_is_refused(count: int) -> None:
    with pytest.raises(ConfigError, match=f"denoising steps must be between 1 and 100, got {count}"):
        make_schedule().sampling_steps(count)


def test_foreign_names_and_rising_schedules_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="no noise schedule named 'cosin'"):
        make_schedule("cosin")
    for values in ([], [0.0, 0.0], [-1.0, 1.0]):
        with pytest.raises(ConfigError, match="a schedule's log-SNR must fall from step to step"):
            Schedule(torch.tensor(values))


def test_amplitudes_keep_the_variance_and_have_the_ratio_that_they_say() -> None:
    levels = torch.tensor([2.0, 0.0, -9.0])
    signal, spread = amplitudes(levels, 3)
    assert signal.shape == (3, 1, 1)
    torch.testing.assert_close(signal.square() + spread.square(), torch.ones(3, 1, 1))
    torch.testing.assert_close((signal.square() / spread.square()).log().flatten(), levels, rtol=1e-5, atol=1e-5)


def test_the_implied_noise_is_the_noise_that_was_added() -> None:
    g = torch.Generator().manual_seed(0)
    clean, noise = torch.randn((3, 4, 6), generator=g), torch.randn((3, 4, 6), generator=g)
    levels = torch.tensor([2.0, -1.0, -9.0])
    torch.testing.assert_close(
        implied_noise(add_noise(clean, noise, levels), clean, levels), noise, rtol=1e-4, atol=1e-5
    )
