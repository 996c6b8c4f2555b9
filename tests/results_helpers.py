"""Numbers that are hard to write and read back, and their bits."""

import math

import numpy as np

EXTREMES = [
    0.1 + 0.2,
    5e-324,
    -0.0,
    1.7976931348623157e308,
    -math.inf,
    math.nan,
    np.nextafter(1.0, 2.0),
    1e22,
]


def bits(values: list[float]) -> bytes:
    return np.asarray(values, dtype=np.float64).tobytes()
