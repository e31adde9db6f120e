import numpy as np
import pytest

from simpick.bop import BopResult, read_results, write_results
from simpick.errors import ConfigError, DatasetError
from simpick.geometry.transforms import random_rotation, transform

HEADER = "scene_id,im_id,obj_id,score,R,t,time"
R = "1 0 0 0 0 -1 0 1 0"


def _file(tmp_path, *lines):
    path = tmp_path / "m_d-test.csv"
    path.write_text("\n".join(lines))
    return path


def test_a_line_is_read_in_metres_row_by_row(tmp_path):
    (result,) = read_results(_file(tmp_path, HEADER, f"2,3,8,0.5,{R},100 -20.5 650,0.13"))
    assert (result.scene_id, result.im_id, result.obj_id, result.score, result.time_s) == (2, 3, 8, 0.5, 0.13)
    np.testing.assert_array_equal(
        result.T_camera_model, [[1, 0, 0, 0.1], [0, 0, -1, -0.0205], [0, 1, 0, 0.65], [0, 0, 0, 1]]
    )


def test_the_header_may_be_missing(tmp_path):
    assert len(read_results(_file(tmp_path, f"2,3,8,0.5,{R},0 0 650,-1", ""))) == 1


def test_results_come_back_exactly(tmp_path):
    rng = np.random.default_rng(0)
    results = [BopResult(1, k, 2, rng.random(), transform(random_rotation(rng), rng.random(3)), 0.5) for k in range(5)]
    write_results(tmp_path / "out.csv", results)
    for new, old in zip(read_results(tmp_path / "out.csv"), results, strict=True):
        assert (new.im_id, new.score, new.time_s) == (old.im_id, old.score, old.time_s)
        np.testing.assert_allclose(new.T_camera_model, old.T_camera_model, rtol=0, atol=1e-15)
    assert (tmp_path / "out.csv").read_text().startswith(HEADER + "\n1,0,2,0.636")


@pytest.mark.parametrize(
    ("line", "text"),
    [
        (f"1,0,2,0.5,{R[:-2]},0 0 650,1", r"m_d-test\.csv, line 3: R must have 9 numbers, row by row, .* has 8\."),
        (f"1,0,2,0.5,{R} 1,0 0 650,1", r"line 3: R must have 9 numbers, row by row, separated by spaces, has 10\."),
        (f"1,0,2,0.5,{R},0 650,1", r"line 3: t must have 3 numbers, .* has 2\."),
        (f"1,0,2,{R},0 0 650,1", r"line 3: must have 7 fields separated by commas \(scene_id,im_id.*\), has 6\."),
        (f"1,0,two,0.5,{R},0 0 650,1", r"line 3: obj_id must be a whole number from 0 to 2147483647, got 'two'"),
        (f"1,0,2,nan,{R},0 0 650,1", r"line 3: score must be finite and at most 1e\+12, got 'nan'"),
        (f"1,0,2,0.5,{R},0 0 0.65,1", r"line 3: t is 0\.65 long; BOP's translations are in millimetres"),
        ("1,0,2,0.5,1 0 0 0 1 0 0 0 -1,0 0 650,1", r"line 3: R must be a rotation matrix, row by row"),
        (f"2,3,8,0.5,{R},0 0 650,0.2", r"line 3: time is 0\.2 s, but an earlier line of scene 2, image 3 has 0\.13 s"),
    ],
)
def test_bad_lines_are_named(tmp_path, line, text):
    path = _file(tmp_path, HEADER, f"2,3,8,0.5,{R},100 -20.5 650,0.13", line)
    with pytest.raises(DatasetError, match=text):
        read_results(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(DatasetError, match=r"cannot read .*none\.csv: No such file or directory\. Give a results CSV"):
        read_results(tmp_path / "none.csv")


def test_different_times_in_one_image_are_not_written(tmp_path):
    results = [BopResult(1, 2, 3, 1.0, np.eye(4), time) for time in (0.1, 0.2)]
    with pytest.raises(
        ConfigError, match=r"time_s must be the same for all estimates of scene 1, image 2, got 0\.1 and"
    ):
        write_results(tmp_path / "out.csv", results)
    assert not (tmp_path / "out.csv").exists()
