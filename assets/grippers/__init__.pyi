from .base import Gripper as Gripper
from .base import GripperBoxes as GripperBoxes
from .jaw import JawGripper as JawGripper
from .jaw_shape import JAW_STROKE_M as JAW_STROKE_M
from .registry import get_gripper as get_gripper
from .registry import gripper_names as gripper_names
from .suction import SuctionGripper as SuctionGripper
