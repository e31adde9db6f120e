"""BOP, the benchmark for 6D object pose: its data sets, results and detections, read and written.

Read: `BopDataset` gives `CameraFrame`, parts, true poses, masks and test targets in simpick's conventions;
`read_results` and `read_detections` take the files that methods exchange. Write: `BopWriter`, `write_results`,
`write_detections`. The conversion of units, pixel centres and frames stands in one place, `simpick.bop.conventions`.

Formats after the BOP toolkit (github.com/thodan/bop_toolkit): ``docs/bop_datasets_format.md``,
``bop_toolkit_lib/dataset_params.py``, ``inout.py``, ``pycoco_utils.py`` and ``scripts/calc_gt_info.py``.
"""

from simpick.bop.detections_json import BopDetection as BopDetection
from simpick.bop.detections_json import detections_of_image as detections_of_image
from simpick.bop.detections_json import read_detections as read_detections
from simpick.bop.detections_json import write_detections as write_detections
from simpick.bop.models import BopModels as BopModels
from simpick.bop.reader import BopDataset as BopDataset
from simpick.bop.results_csv import BopResult as BopResult
from simpick.bop.results_csv import parse_result_name as parse_result_name
from simpick.bop.results_csv import read_results as read_results
from simpick.bop.results_csv import write_results as write_results
from simpick.bop.scene_reader import BopScene as BopScene
from simpick.bop.scene_reader import BopTruth as BopTruth
from simpick.bop.targets import BopTarget as BopTarget
from simpick.bop.writer import BopInstance as BopInstance
from simpick.bop.writer import BopWriter as BopWriter
