"""Grasping: candidates on the CAD, verification in simulation, storage, and the choice of a grasp in the bin."""

from simpick.grasping.failure_memory import FailureMemory as FailureMemory
from simpick.grasping.part_grasps import candidate_grasps as candidate_grasps
from simpick.grasping.part_grasps import jaw_grasps as jaw_grasps
from simpick.grasping.part_grasps import suction_grasps as suction_grasps
from simpick.grasping.part_grasps import verified_grasps as verified_grasps
from simpick.grasping.planner import GraspPlanner as GraspPlanner
from simpick.grasping.planner import PlannerConfig as PlannerConfig
from simpick.grasping.planner import WorldGrasp as WorldGrasp
