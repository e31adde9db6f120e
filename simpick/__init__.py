"""simpick: a wind tunnel for robotic bin picking.

Public names, each loaded with its libraries on first use:

===================  ==================================================================================================
`BinPickEnv`         a bin of parts to be picked empty: the gymnasium environment ``simpick/BinPick-v0``
`get_part`           a library part, one that you added, or a mesh file, as a `simpick.assets.Part`
`load_estimator`     a pose estimator by name: ``load_estimator("refined")``
`Perception`         a detector and a pose estimator, which together find parts in an image
`PickPolicy`         perception, the choice of a grasp, and memory of failures: from an observation to an action
`run_episode`        let a policy pick one bin empty; returns every pick with its outcome and cause
`estimate`           poses of CAD parts in a photograph, in the frame of the CAD file
`compare`            let several perception modes pick the same bins; returns paired statistics
===================  ==================================================================================================

Importing this package registers the gymnasium environments, by string, and loads neither torch nor MuJoCo nor rerun.
Whatever else is public stands one level below: `simpick.assets`, `simpick.estimators`, `simpick.policies` and so on.
"""

import lazy_loader
from gymnasium.envs.registration import register as _register

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

_register(
    id="simpick/BinPick-v0",
    entry_point="simpick.envs.bin_pick:BinPickEnv",
    vector_entry_point="simpick.envs.bin_pick_vector:BinPickVectorEnv",
)
_register(id="simpick/BinServo-v0", entry_point="simpick.envs.bin_servo:BinServoEnv")
