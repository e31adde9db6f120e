from .compare_config import CompareConfig as CompareConfig
from .comparison import Comparison as Comparison
from .comparison import compare as compare
from .episodes import run_episode as run_episode
from .result_store import EpisodeResult as EpisodeResult
from .run_config import RunConfig as RunConfig
