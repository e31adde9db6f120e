"""Property tests draw the same examples in every run, and a busy machine fails none of them."""

from hypothesis import settings

settings.register_profile("simpick", derandomize=True, deadline=None, max_examples=50)
settings.load_profile("simpick")
