"""What a planned belief costs, one file each."""

from .certainty_equivalent import CertaintyEquivalent
from .risk_sensitive import RiskSensitive

__all__ = ["CertaintyEquivalent", "RiskSensitive"]
