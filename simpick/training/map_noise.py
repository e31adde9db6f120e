"""Pose errors of noisy pose maps as a function of the noise: the reason for the shifted noise schedule.

Noise of standard deviation s on clean maps is a log-SNR of -2 ln s. Maps repeat one pose in p^2 cells, so decoding
averages the noise out. At low noise a denoiser can read the pose from the map and does not learn from the image.
``python -m simpick.training.map_noise --out FILE.png`` measures and plots this.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import tyro
from jaxtyping import Float

from simpick.estimators.raypose.diffusion.schedule import SCHEDULES, make_schedule
from simpick.estimators.raypose.network.pose_maps import CHANNELS, ViewPoses, decode_pose_maps, encode_pose_maps
from simpick.geometry.torch_rotations import random_rotations, rotation_angle
from simpick.plotting import new_figure, save_figure

CELLS = (3, 6, 8, 16)
DEVIATIONS = np.geomspace(0.1, 100.0, 25)
_PADDING = 1.2


@dataclass(frozen=True, eq=False)
class MapNoise:
    """Median errors of decoded poses, one per noise level."""

    deviations: Float[np.ndarray, "levels"]
    """Standard deviation of the noise on every channel of clean maps."""
    rotation_deg: Float[np.ndarray, "levels"]
    centre_box_sides: Float[np.ndarray, "levels"]
    """Error of the part's projected origin, in sides of the box."""
    depth_percent: Float[np.ndarray, "levels"]

    def readable_share(self, schedule: str, limit_deg: float) -> float:
        """Return the share of a schedule's timesteps at which the rotation can be read from noisy maps alone."""
        deviations = (-make_schedule(schedule).log_snrs.double() / 2).exp().numpy()
        errors = np.interp(np.log(deviations), np.log(self.deviations), self.rotation_deg)
        return float((errors < limit_deg).mean())


def measure(
    cells: int,
    deviations: Float[np.ndarray, "levels"],
    *,
    samples: int = 2000,
    generator: torch.Generator,
) -> MapNoise:
    """Return the errors of random poses' maps with p = `cells` under noise of these standard deviations."""
    R = random_rotations((2, samples), generator)
    centre = torch.rand((2, samples, 2), generator=generator) - 0.5
    query, reference = (ViewPoses(R[k], centre[k], torch.full((samples,), 0.05)) for k in range(2))
    clean = encode_pose_maps(query, reference, cells, _PADDING)
    medians = []
    for deviation in deviations:
        noise = torch.randn((samples, cells, cells, CHANNELS), generator=generator)
        decoded = decode_pose_maps(clean + float(deviation) * noise, reference, _PADDING)
        rotations = torch.rad2deg(rotation_angle(decoded.R @ query.R.mT))
        centres = torch.linalg.vector_norm(decoded.centre - query.centre, dim=-1) * (_PADDING / 2)
        # A depth that is too large by a factor counts like one that is too small by it.
        depth = 100 * ((decoded.half_extent_at_depth_m / query.half_extent_at_depth_m).log().abs().exp() - 1)
        medians.append([float(x.median()) for x in (rotations, centres, depth)])
    return MapNoise(deviations, *np.array(medians).T)


def draw(path: Path, results: dict[int, MapNoise]) -> None:
    """Write the curves as PNG; keys are p.

    Raises:
        OutputError: the file cannot be written.
    """
    figure = new_figure(10.4, 3.3)
    panels = [
        ("rotation error (deg)", "rotation_deg", (0.3, 200)),
        ("centre error (box sides)", "centre_box_sides", (3e-3, 10)),
        ("depth error (%)", "depth_percent", (0.3, 1000)),
    ]
    spans = {name: (-make_schedule(name).log_snrs.double() / 2).exp().numpy() for name in ("log_snr", "cosine")}
    for axes, (label, name, limits) in zip(figure.subplots(1, 3), panels, strict=True):
        for (cells, result), colour in zip(results.items(), ("C0", "C1", "C2", "C3", "C4", "C5"), strict=False):
            axes.loglog(result.deviations, getattr(result, name), color=colour, label=f"p = {cells}")
        shifted, cosine = spans["log_snr"], np.quantile(spans["cosine"], [0.1, 0.9])
        axes.axvspan(shifted[0], shifted[-1], color="0.9", label="log_snr: all steps")
        axes.axvspan(cosine[0], cosine[1], ymax=0.04, color="0.4", label="cosine: 80 % of steps")
        axes.set(xlabel="noise (std. per channel)", ylabel=label, ylim=limits)
        axes.set_xlim(DEVIATIONS[0], DEVIATIONS[-1])
        axes.grid(alpha=0.4)
        top = axes.secondary_xaxis("top", functions=(lambda x: x, lambda x: x))
        levels = np.array([4, 2, 0, -2, -4, -6, -8])
        top.set_xticks(np.exp(-levels / 2), [str(level) for level in levels])
        top.minorticks_off()
        top.set_xlabel("log-SNR")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), fontsize=8, loc="outside right upper")
    save_figure(figure, path, dpi=72)


def table(results: dict[int, MapNoise], schedules: Sequence[str] = SCHEDULES, limit_deg: float = 10.0) -> str:
    """Return for each p and schedule the share of steps at which the rotation can be read from the noisy map."""
    lines = [f"share of steps at which the median rotation error of the noisy map is below {limit_deg:g} deg"]
    lines += [" " * 6 + "".join(f"{name:>10}" for name in schedules)]
    for cells, result in results.items():
        shares = "".join(f"{100 * result.readable_share(name, limit_deg):>8.0f} %" for name in schedules)
        lines.append(f"p = {cells:<2}{shares}")
    return "\n".join(lines)


def main(out: Path, samples: int = 2000, seed: int = 0) -> None:
    """Measure the decoded errors of noisy pose maps and draw them.

    Args:
        out: PNG file to write.
        samples: random poses per noise level.
        seed: of the poses and the noise.
    """
    generator = torch.Generator().manual_seed(seed)
    results = {cells: measure(cells, DEVIATIONS, samples=samples, generator=generator) for cells in CELLS}
    draw(out, results)
    print(table(results))


if __name__ == "__main__":
    tyro.cli(main)
