"""BOP, the benchmark for 6D object pose: reading and writing its data sets, results and detections.

`BopDataset` reads `CameraFrame`, parts, true poses, masks and test targets in simpick's conventions; `read_results`
and `read_detections` read the files that methods exchange. `BopWriter`, `write_results` and `write_detections` write
them. Units, pixel centres and frames are converted in `simpick.bop.conventions` only.

Formats follow the BOP toolkit (github.com/thodan/bop_toolkit): ``docs/bop_datasets_format.md``,
``bop_toolkit_lib/dataset_params.py``, ``inout.py``, ``pycoco_utils.py`` and ``scripts/calc_gt_info.py``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
