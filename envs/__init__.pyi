from .actions import decode_action as decode_action
from .actions import encode_action as encode_action
from .bin_pick import BinPickEnv as BinPickEnv
from .bin_pick_vector import BinPickVectorEnv as BinPickVectorEnv
from .bin_servo import BinServoEnv as BinServoEnv
from .observations import frame_from_observation as frame_from_observation
