"""Policies: perception, grasp choice and memory of failures, behind one method, `act`."""

from simpick.policies.base import Policy as Policy
from simpick.policies.grasp_chooser import GraspChooser as GraspChooser
from simpick.policies.perception import Percept as Percept
from simpick.policies.perception import Perception as Perception
from simpick.policies.perception import perceive_together as perceive_together
from simpick.policies.pick_policy import Decision as Decision
from simpick.policies.pick_policy import PickPolicy as PickPolicy
from simpick.policies.pose_observation import PoseObservation as PoseObservation
from simpick.policies.vector import PoseVectorObservation as PoseVectorObservation
from simpick.policies.vector import VectorPickPolicy as VectorPickPolicy
