"""Policies: perception, grasp choice and memory of failures, behind one method, `act`."""

from simpick.policies.base import Policy as Policy
from simpick.policies.perception import Percept as Percept
from simpick.policies.perception import Perception as Perception
from simpick.policies.pick_policy import Decision as Decision
from simpick.policies.pick_policy import PickPolicy as PickPolicy
from simpick.policies.pose_observation import PoseObservation as PoseObservation
