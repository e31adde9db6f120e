"""simpick: a wind tunnel for robotic bin picking.

Importing this package loads neither torch nor mujoco nor rerun: it only registers the gymnasium environments, by
string, so that ``gymnasium.make("simpick:simpick/BinPick-v0")`` works.
"""

from gymnasium.envs.registration import register as _register

__version__ = "0.1.0"

_register(
    id="simpick/BinPick-v0",
    entry_point="simpick.envs.bin_pick:BinPickEnv",
    vector_entry_point="simpick.envs.bin_pick_vector:BinPickVectorEnv",
)
_register(id="simpick/BinServo-v0", entry_point="simpick.envs.bin_servo:BinServoEnv")
