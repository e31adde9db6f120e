"""What is said about a part before it is picked."""

from __future__ import annotations

import pytest
import trimesh

from simpick.assets import get_part, load_cad
from simpick.errors import ConfigError
from simpick.grasping.part_report import (
    Gripping,
    difficulties,
    gripping,
    no_grasp_reason,
    pixels_in_overhead_image,
    recommended,
)


def box_part(tmp_path, extents):
    trimesh.creation.box(extents).export(tmp_path / "box.stl")
    return load_cad(tmp_path / "box.stl", unit="mm")


def test_the_gripper_that_covers_more_is_recommended_and_the_first_wins_a_tie():
    jaw, suction = Gripping("jaw", 50, 40, 0.62), Gripping("suction", 50, 40, 0.98)
    assert recommended([jaw, suction]) is suction
    even = Gripping("jaw", 50, 40, 0.981)
    assert recommended([even, suction]) is even
    assert recommended([Gripping("jaw", 0, 0, 0.0), Gripping("suction", 9, 4, 0.0)]) is None


@pytest.mark.parametrize(
    ("option", "reason"),
    [
        (Gripping("jaw", 0, 0, 0.0), "no place on its surface suits the gripper"),
        (Gripping("jaw", 50, 0, 0.0), "none of 50 sampled grasps holds in simulation"),
        (Gripping("jaw", 50, 9, 0.0), "two of its 9 grasps can be reached in only 0% of its resting poses"),
    ],
)
def test_why_there_is_no_grasp_is_said(option, reason):
    assert no_grasp_reason(option).startswith(reason)


def test_a_part_wider_than_the_jaw_has_no_jaw_grasp(tmp_path):
    option = gripping(box_part(tmp_path, [150, 140, 110]), "jaw")
    assert option == Gripping("jaw", 0, 0, 0.0) and not option.is_possible


def test_pixels_are_those_of_the_mean_shadow(tmp_path):
    # 480 pixels over 2 x 0.9 m x tan(14 deg); Cauchy: a quarter of the surface.
    area, width = pixels_in_overhead_image(box_part(tmp_path, [40, 30, 20]))
    assert area == pytest.approx(5200 / 4 * (480 / 448.8) ** 2, rel=1e-3)
    assert width == pytest.approx(30 * 480 / 448.8, rel=1e-3)


@pytest.mark.parametrize(
    ("extents", "text"),
    [([4, 2, 1], "small in the image: about 8 pixels, 2.1 wide, where 150 and 6 are needed"),
     ([200, 30, 20], "long: 200 mm in a bin of 300 mm"), ([60, 30, 2], "thin: lying flat it is 2.0 mm high"),
     ([90, 80, 70], "heavy: 605 g")],
)  # fmt: skip
def test_what_will_be_hard_is_said(tmp_path, extents, text):
    assert any(reason.startswith(text) for reason in difficulties(box_part(tmp_path, extents), []))


@pytest.mark.parametrize(
    ("coverage", "said"), [(0.96, []), (0.85, ["jaw: only 85% of its resting poses can be gripped"])]
)
def test_resting_poses_that_cannot_be_gripped_are_said(tmp_path, coverage, said):
    found = list(difficulties(box_part(tmp_path, [40, 30, 20]), [Gripping("jaw", 50, 40, coverage)]))
    assert [reason.partition(";")[0] for reason in found] == said


def test_a_part_that_is_easy_has_no_difficulties():
    part = get_part("hex_bolt")
    assert list(difficulties(part, [gripping(part, "jaw")])) == []


def test_a_run_with_parts_that_cannot_be_gripped_stops_before_it_starts(tmp_path):
    from simpick.cli.run import Run
    from simpick.experiments.config import RunConfig

    box_part(tmp_path, [150, 140, 110])
    run = Run(RunConfig(parts=(f"{tmp_path / 'box.stl'}@mm",)), tmp_path / "out")
    with pytest.raises(ConfigError, match=r"the jaw gripper can hold none of these parts: .*no place on its surface"):
        run.run()
    assert not (tmp_path / "out").exists()
