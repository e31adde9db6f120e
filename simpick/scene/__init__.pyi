from .builder import build_scene as build_scene
from .config import BinConfig as BinConfig
from .config import CameraConfig as CameraConfig
from .config import SceneConfig as SceneConfig
from .contacts import ContactGroup as ContactGroup
from .physics import PhysicsConfig as PhysicsConfig
from .scene import Instance as Instance
from .scene import Scene as Scene
