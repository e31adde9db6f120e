"""Training: data streamed from renderer processes, and what is learned from it."""
