"""BOP, the benchmark for 6D object pose: its data sets, results and detections, read and written.

Read: `BopDataset` gives `CameraFrame`, parts, true poses, masks and test targets in simpick's conventions;
`read_results` and `read_detections` take the files that methods exchange. Write: `BopWriter`, `write_results`,
`write_detections`. The conversion of units, pixel centres and frames stands in one place, `simpick.bop.conventions`.

Formats after the BOP toolkit (github.com/thodan/bop_toolkit): ``docs/bop_datasets_format.md``,
``bop_toolkit_lib/dataset_params.py``, ``inout.py``, ``pycoco_utils.py`` and ``scripts/calc_gt_info.py``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
