"""What a scene is made of: parts, bins, robots, grippers and shipped weights."""
