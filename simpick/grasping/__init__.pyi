from .failure_memory import FailureMemory as FailureMemory
from .part_grasps import candidate_grasps as candidate_grasps
from .part_grasps import symmetric_grasps as symmetric_grasps
from .part_grasps import verified_grasps as verified_grasps
from .planner import GraspPlanner as GraspPlanner
from .planner import PlannerConfig as PlannerConfig
from .planner import WorldGrasp as WorldGrasp
