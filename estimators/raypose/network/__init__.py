"""The RayPose network."""
