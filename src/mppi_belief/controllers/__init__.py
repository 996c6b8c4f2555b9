"""Controllers, one file each."""

from .mppi_belief import MPPIBelief

__all__ = ["MPPIBelief"]
