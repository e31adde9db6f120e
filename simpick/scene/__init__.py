"""Scenes: composition of the cell, physics, filling the bin, and the truth about it."""

from simpick.scene.builder import build_scene as build_scene
from simpick.scene.config import BinConfig as BinConfig
from simpick.scene.config import CameraConfig as CameraConfig
from simpick.scene.config import SceneConfig as SceneConfig
from simpick.scene.contacts import ContactGroup as ContactGroup
from simpick.scene.physics import PhysicsConfig as PhysicsConfig
from simpick.scene.scene import Instance as Instance
from simpick.scene.scene import Scene as Scene
