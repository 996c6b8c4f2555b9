"""Systems that several tests use, with numbers of their own."""

import numpy as np

import mppi_belief as mb

BEACONS = np.array([[1.0, -2.0], [5.0, 2.0], [2.0, 3.0]])
ANCHOR = np.array([3.0, 0.5])
NOISE = {"distance_floor": 0.1, "distance_slope": 0.2, "bearing_floor": 0.03, "bearing_slope": 0.05}


def beacons(**changed) -> mb.Beacons:
    obstacles = mb.Obstacles(centers=[[3, 1]], radius=0.5)
    given = {
        "obstacles": obstacles,
        "beacons": BEACONS,
        "anchor": ANCHOR,
        "turn_noise": 0.2,
        "speed_noise": 0.4,
    }
    return mb.Beacons(**given | NOISE | changed)


def turned(angle: np.ndarray, period: float = 2 * np.pi) -> np.ndarray:
    """The same angle within half a period of zero."""
    return (angle + period / 2) % period - period / 2


def pendulum(**changed) -> mb.Pendulum:
    given = {"obstacles": mb.Obstacles([[2.0]], 0.25), "gravity": 3.0, "damping": 0.5}
    return mb.Pendulum(
        **given | {"process_noise": 0.3, "sensor_noise": 0.1, "anchor": 1.2} | changed
    )
