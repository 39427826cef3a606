"""Robot models on Pinocchio: M, C, G, J, J̇, the operational-space terms, and inverse kinematics.

>>> from vic_toolbox.models import load_robot
>>> panda = load_robot("panda")
>>> panda.mass_matrix(panda.home).shape
(7, 7)
"""

from vic_toolbox.models.catalogue import (
    RobotDescription,
    available_robots,
    find_robot,
    robots_directory,
)
from vic_toolbox.models.load import load_robot
from vic_toolbox.models.operational_space import OperationalSpace, SingularityWarning
from vic_toolbox.models.robot import RobotModel

__all__ = [
    "OperationalSpace",
    "RobotDescription",
    "RobotModel",
    "SingularityWarning",
    "available_robots",
    "find_robot",
    "load_robot",
    "robots_directory",
]
