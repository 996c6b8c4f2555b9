"""Where paths are drawn and with which density, one file each."""

from .innovation import InnovationSampler
from .laplace import LaplaceSampler
from .nominal import NominalSampler

__all__ = ["InnovationSampler", "LaplaceSampler", "NominalSampler"]
