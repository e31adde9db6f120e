"""Crops of queries and templates, and the choice of templates."""
