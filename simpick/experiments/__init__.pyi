from .comparison import Comparison as Comparison
from .comparison import compare as compare
from .config import CompareConfig as CompareConfig
from .config import RunConfig as RunConfig
from .episodes import run_episode as run_episode
from .result_store import EpisodeResult as EpisodeResult
