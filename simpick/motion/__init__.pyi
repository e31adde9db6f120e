from .config import MotionConfig as MotionConfig
from .executor import PickExecutor as PickExecutor
from .kinematics import Kinematics as Kinematics
from .planner import NoPlan as NoPlan
from .planner import PickPlan as PickPlan
from .planner import PickPlanner as PickPlanner
from .twist_servo import TwistServo as TwistServo
