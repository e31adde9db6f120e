"""simpick: a wind tunnel for robotic bin picking.

Importing this package loads neither torch nor mujoco nor rerun; it only registers the gymnasium environments by
string when gymnasium is imported (``gymnasium.make("simpick/BinPick-v0")``).
"""

__version__ = "0.1.0"
