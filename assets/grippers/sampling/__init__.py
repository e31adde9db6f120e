"""Sampling of grasps on a CAD mesh: the two shipped methods, and the tools that a new gripper's method can use."""
