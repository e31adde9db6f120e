"""Visible surface discrepancy (VSD) on rendered depth, as computed by the BOP toolkit since 2019.

Depth images are input, rendered by any renderer with the query's own camera. Sources: Hodan et al., "BOP Challenge 2020
on 6D Object Localization"; for visibility, Hodan et al., "On Evaluation of 6D Object Pose Estimation", 2016.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from simpick.errors import ConfigError
from simpick.geometry import Pinhole

VSD_DELTA_M = 0.015
"""Tolerance of the visibility test; BOP uses 15 mm for all data sets except ITODD (5 mm)."""
VSD_TAUS = np.arange(0.05, 0.51, 0.05)
"""Misalignment tolerances as fractions of the diameter."""


def distance_from_depth(
    depth_m: Float[np.ndarray, "*batch height width"], camera: Pinhole
) -> Float[np.ndarray, "*batch height width"]:
    """Return distances from the camera's centre in metres; 0 (no reading) stays 0.

    Raises:
        ConfigError: the image's size is not the camera's.
    """
    _check_size(depth_m, camera)
    return depth_m.astype(float) * np.linalg.norm(camera.rays(), axis=-1)


def visible_mask(
    distance_m: Float[np.ndarray, "*batch pixels"],
    distance_scene_m: Float[np.ndarray, "*#batch pixels"],
    delta_m: float = VSD_DELTA_M,
) -> Bool[np.ndarray, "*batch pixels"]:
    """Return where a rendered part is visible: at most `delta_m` behind the scene, or without reading of the scene."""
    return (distance_m > 0) & ((distance_m - distance_scene_m <= delta_m) | (distance_scene_m == 0))


def vsd(
    depths_estimate_m: Float[np.ndarray, "e height width"],
    depths_truth_m: Float[np.ndarray, "g height width"],
    depth_scene_m: Float[np.ndarray, "height width"],
    camera: Pinhole,
    diameter_m: float,
    *,
    delta_m: float = VSD_DELTA_M,
    taus: Float[np.ndarray, "t"] = VSD_TAUS,
    candidates: Bool[np.ndarray, "e g"] | None = None,
) -> Float[np.ndarray, "e g t"]:
    """Return the VSD of every pair of estimate and truth at every tolerance, in [0, 1].

    It is the fraction of pixels in the union of both visible masks that are in one mask only or where both distances
    differ by `tau` diameters or more. An estimate also counts as visible where the truth is visible and the estimate
    has depth, even behind the scene's surface. Pairs that are not `candidates` get 1, as do empty unions.
    """
    for depth_m in (depths_estimate_m, depths_truth_m, depth_scene_m):
        _check_size(depth_m, camera)
    # Parts cover a small fraction of an image; only there depth is converted to distance.
    touched = np.flatnonzero((depths_estimate_m > 0).any(0) | (depths_truth_m > 0).any(0))
    per_depth = np.linalg.norm(camera.rays().reshape(-1, 3)[touched], axis=-1)
    estimate, truth, scene = (
        depth_m.reshape(-1, camera.height * camera.width)[:, touched].astype(float) * per_depth
        for depth_m in (depths_estimate_m, depths_truth_m, depth_scene_m)
    )
    truth_seen = visible_mask(truth, scene, delta_m)
    estimate_seen_alone = visible_mask(estimate, scene, delta_m)
    errors = np.ones((len(estimate), len(truth), len(taus)))
    for e in range(len(estimate)):
        for g in range(len(truth)):
            if candidates is not None and not candidates[e, g]:
                continue
            estimate_seen = estimate_seen_alone[e] | (truth_seen[g] & (estimate[e] > 0))
            both = truth_seen[g] & estimate_seen
            union = np.count_nonzero(truth_seen[g] | estimate_seen)
            if union == 0:
                continue
            apart = np.abs(truth[g, both] - estimate[e, both]) / diameter_m
            # The number of tolerances that each pixel fails (apart >= tau), then the number of pixels that fail each.
            fails = np.bincount(np.searchsorted(taus, apart, side="right"), minlength=len(taus) + 1)
            costs = fails[::-1].cumsum()[::-1][1:]
            errors[e, g] = (costs + union - np.count_nonzero(both)) / union
    return errors


def _check_size(depth_m: Float[np.ndarray, "*batch height width"], camera: Pinhole) -> None:
    if depth_m.shape[-2:] != (camera.height, camera.width):
        raise ConfigError(
            f"depth must be {camera.width} x {camera.height} px like its camera, "
            f"got {depth_m.shape[-1]} x {depth_m.shape[-2]}; render it with the camera of the frame"
        )
