"""Gymnasium environments; ids are registered by ``import simpick``."""
