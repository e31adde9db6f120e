"""Evaluation of pose estimators: the pose benchmark's fixed bins, new bins, BOP data sets, tables."""
