"""Grippers: a two-finger parallel jaw and a suction head, both on MuJoCo primitives and both behind one protocol."""

from simpick.assets.grippers.base import Gripper as Gripper
from simpick.assets.grippers.base import GripperBoxes as GripperBoxes
from simpick.assets.grippers.jaw import JAW_STROKE_M as JAW_STROKE_M
from simpick.assets.grippers.jaw import JawGripper as JawGripper
from simpick.assets.grippers.jaw import add_jaw_gripper as add_jaw_gripper
from simpick.assets.grippers.suction import SUCTION_RADIUS_M as SUCTION_RADIUS_M
from simpick.assets.grippers.suction import SuctionGripper as SuctionGripper
from simpick.assets.grippers.suction import add_suction_gripper as add_suction_gripper
