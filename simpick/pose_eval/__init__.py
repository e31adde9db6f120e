"""Pose estimators measured on images: fixed bins, BOP data sets, tables."""
