"""RayPose: 6D poses of unseen parts by bundling rays of template views (Huang et al., ICCV 2025)."""

from simpick.estimators.raypose.checkpoints import load_checkpoint as load_checkpoint
from simpick.estimators.raypose.checkpoints import save_checkpoint as save_checkpoint
from simpick.estimators.raypose.estimator import RayPoseEstimator as RayPoseEstimator
from simpick.estimators.raypose.estimator import RayPoseEstimatorConfig as RayPoseEstimatorConfig
from simpick.estimators.raypose.estimator import load_raypose as load_raypose
from simpick.estimators.raypose.network.config import PRESETS as PRESETS
from simpick.estimators.raypose.network.config import RayPoseConfig as RayPoseConfig
from simpick.estimators.raypose.network.model import RayPose as RayPose
