"""Systems (1a)(1b), one file each."""

from .beacons import Beacons
from .light_dark import LightDark
from .linear import Linear
from .pendulum import Pendulum
from .point_robot import PointRobot
from .scalar_linear import ScalarLinear
from .steered import Steered

__all__ = ["Beacons", "LightDark", "Linear", "Pendulum", "PointRobot", "ScalarLinear", "Steered"]
