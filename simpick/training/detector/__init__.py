"""Training of the instance detector: bins of random parts, crops of them, losses, and the loop."""
