"""Robot arms, built in code from primitive geoms."""
