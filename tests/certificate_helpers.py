"""Assertions about certificates."""

import numpy as np

from mppi_belief.results.certificate import Certificate

LONGEST_NUMBER = 90  # characters of a check's name that fit a table
LONGEST_BAND = 80  # characters of a band's source that fit a table


def assert_holds(certificate: Certificate) -> None:
    """Assert that all checks hold, their texts fit a table, and all curves can be drawn."""
    assert certificate.holds, [check for check in certificate.checks if not check.holds]
    for check in certificate.checks:
        assert len(check.computed) <= LONGEST_NUMBER
        assert len(check.derived) <= LONGEST_BAND
    for panel in certificate.panels:
        assert all(np.all(np.isfinite(line.y)) for line in panel.lines)
