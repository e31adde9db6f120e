"""Weights that come with simpick, one model card beside each."""
