from .base import NullRecorder as NullRecorder
from .base import Recorder as Recorder
from .column_buffer import Instant as Instant
from .mujoco_logger import MujocoLogger as MujocoLogger
from .mujoco_logger import log_mujoco_model as log_mujoco_model
from .read_back import metrics_from_rrd as metrics_from_rrd
from .read_back import properties_from_rrd as properties_from_rrd
from .rerun_recorder import RerunRecorder as RerunRecorder
