"""The diffusion process: noise schedules, parameterization, sampler."""
