"""Controllers, one file each."""

from .belief_joint import JointBelief
from .ekf_ilqg import EKFiLQG
from .lqg import LQG
from .mppi_belief import MPPIBelief
from .pipf import PIPF

__all__ = ["LQG", "PIPF", "EKFiLQG", "JointBelief", "MPPIBelief"]
