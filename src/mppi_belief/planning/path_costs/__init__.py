"""Charges a planned belief, one path cost per file."""

from .certainty_equivalent import CertaintyEquivalent
from .chance_constrained import ChanceConstrained
from .risk_sensitive import RiskSensitive

__all__ = ["CertaintyEquivalent", "ChanceConstrained", "RiskSensitive"]
