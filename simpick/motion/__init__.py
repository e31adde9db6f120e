"""Motion: inverse kinematics, trajectories, and picks that tell what happened and why."""

from simpick.motion.config import MotionConfig as MotionConfig
from simpick.motion.executor import PickExecutor as PickExecutor
from simpick.motion.gripper_servo import GripperServo as GripperServo
from simpick.motion.kinematics import Kinematics as Kinematics
from simpick.motion.planner import NoPlan as NoPlan
from simpick.motion.planner import PickPlan as PickPlan
from simpick.motion.planner import PickPlanner as PickPlanner
from simpick.motion.result import PickResult as PickResult
from simpick.motion.twist_servo import TwistServo as TwistServo
