from .base import Gripper as Gripper
from .base import GripperBoxes as GripperBoxes
from .jaw import JAW_STROKE_M as JAW_STROKE_M
from .jaw import JawGripper as JawGripper
from .jaw import add_jaw_gripper as add_jaw_gripper
from .suction import SUCTION_RADIUS_M as SUCTION_RADIUS_M
from .suction import SuctionGripper as SuctionGripper
from .suction import add_suction_gripper as add_suction_gripper
