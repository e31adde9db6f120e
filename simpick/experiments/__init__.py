"""Closed-loop experiments: runs, comparisons, sweeps, and where their results come from."""
