import pytest

from simpick.errors import DatasetError
from simpick.recording import metrics_from_rrd


def test_missing_file_is_a_dataset_error(tmp_path):
    with pytest.raises(DatasetError, match=r"none\.rrd: no such recording"):
        metrics_from_rrd(tmp_path / "none.rrd")


def test_foreign_file_is_a_dataset_error(tmp_path):
    path = tmp_path / "foreign.rrd"
    path.write_text("this is no recording")
    with pytest.raises(DatasetError, match=r"foreign\.rrd: not a readable rerun recording"):
        metrics_from_rrd(path)
