"""What every certificate must be."""

import numpy as np

from mppi_belief.results.certificate import Certificate


def assert_holds(certificate: Certificate) -> None:
    """It holds, its texts fit a table, its curves can be drawn."""
    assert certificate.holds, [check for check in certificate.checks if not check.holds]
    assert all(
        len(check.computed) <= 90 and len(check.derived) <= 80 for check in certificate.checks
    )
    assert all(np.all(np.isfinite(line.y)) for panel in certificate.panels for line in panel.lines)
