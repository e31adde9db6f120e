from .assets import get_part as get_part
from .envs import BinPickEnv as BinPickEnv
from .estimators import load_estimator as load_estimator
from .experiments import compare as compare
from .experiments import run_episode as run_episode
from .photos import estimate as estimate
from .policies import Perception as Perception
from .policies import PickPolicy as PickPolicy

__version__: str
