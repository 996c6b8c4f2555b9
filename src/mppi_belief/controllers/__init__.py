"""Controllers, one file each."""

from .ekf_ilqg import EKFiLQG
from .lqg import LQG
from .mppi import MPPI, OracleMPPI
from .pipf import PIPF, AverageOfParticles, PooledPaths

__all__ = ["LQG", "MPPI", "PIPF", "AverageOfParticles", "EKFiLQG", "OracleMPPI", "PooledPaths"]
