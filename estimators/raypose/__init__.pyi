from .checkpoints import load_checkpoint as load_checkpoint
from .checkpoints import save_checkpoint as save_checkpoint
from .estimator import RayPoseEstimator as RayPoseEstimator
from .estimator import load_raypose as load_raypose
from .estimator_config import RayPoseEstimatorConfig as RayPoseEstimatorConfig
from .network.config import PRESETS as PRESETS
from .network.config import RayPoseConfig as RayPoseConfig
from .network.model import RayPose as RayPose
