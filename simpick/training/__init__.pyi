from .config import TrainConfig as TrainConfig
from .trainer import Budget as Budget
from .trainer import train as train
