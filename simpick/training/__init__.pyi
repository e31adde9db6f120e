from .budget import Budget as Budget
from .config import TrainConfig as TrainConfig
from .trainer import train as train
