"""Weights that ship with simpick, each with a model card."""
