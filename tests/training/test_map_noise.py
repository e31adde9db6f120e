"""The study of noise on pose maps, against what statistics says."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from simpick.errors import OutputError
from simpick.training.map_noise import MapNoise, draw, main, measure, table

LEVELS = np.array([0.1, 0.5, 300.0])


@pytest.fixture(scope="module")
def results() -> dict[int, MapNoise]:
    g = torch.Generator().manual_seed(0)
    return {cells: measure(cells, LEVELS, samples=1500, generator=g) for cells in (3, 6)}


def test_centre_and_depth_errors_are_those_of_a_mean_over_cells(results: dict[int, MapNoise]) -> None:
    for cells, result in results.items():
        deviation = LEVELS[:2] / cells
        # Medians of the length of a plane Gaussian, and of the size of a Gaussian.
        np.testing.assert_allclose(result.centre_box_sides[:2], 1.1774 * deviation, rtol=0.1)
        np.testing.assert_allclose(result.depth_percent[:2], 100 * np.expm1(0.6745 * deviation), rtol=0.15)


def test_rotations_get_worse_with_noise_up_to_chance_and_better_with_cells(results: dict[int, MapNoise]) -> None:
    few, many = results[3].rotation_deg, results[6].rotation_deg
    assert (few[:2] > 1.7 * many[:2]).all()
    assert (np.diff(few) > 0).all()
    # Of uniform random rotations: the angle at which (a - sin a) / pi is one half.
    np.testing.assert_allclose([few[2], many[2]], 132.3, atol=4)


def test_the_readable_share_counts_a_schedules_steps() -> None:
    levels = np.geomspace(0.1, 100, 50)
    # The error is 10 deg at a deviation of 1, a log-SNR of 0: 2 of 11 units of log_snr are below.
    noise = MapNoise(levels, 10 * levels, levels, levels)
    assert noise.readable_share("log_snr", 10.0) == pytest.approx(2 / 11, abs=0.01)
    assert noise.readable_share("cosine", 10.0) == pytest.approx(0.5, abs=0.02)
    # Twice the deviation is a log-SNR lower by 2 ln 2.
    assert noise.readable_share("log_snr", 20.0) == pytest.approx((2 + 2 * math.log(2)) / 11, abs=0.01)
    assert table({6: noise}).splitlines()[1:] == [
        "         log_snr    cosine    linear",
        "p = 6       18 %      49 %      26 %",
    ]


def test_measurements_repeat_themselves(results: dict[int, MapNoise]) -> None:
    again = measure(3, LEVELS, samples=1500, generator=torch.Generator().manual_seed(0))
    assert np.array_equal(again.rotation_deg, results[3].rotation_deg)


def test_the_script_draws_and_prints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(tmp_path / "noise.png", samples=20)
    picture = cv2.imread(str(tmp_path / "noise.png"))
    assert picture is not None
    assert picture.shape[0] > 200
    assert picture.std() > 10
    lines = capsys.readouterr().out.splitlines()
    assert [line[:6] for line in lines[2:]] == ["p = 3 ", "p = 6 ", "p = 8 ", "p = 16"]


def test_a_picture_that_cannot_be_written(tmp_path: Path, results: dict[int, MapNoise]) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match=r"cannot write to .*file"):
        draw(tmp_path / "file" / "noise.png", results)
