"""Systems that several tests use, with numbers of their own."""

import numpy as np

import mppi_belief as mb

BEACONS = np.array([[1.0, -2.0], [5.0, 2.0], [2.0, 3.0]])
ANCHOR = np.array([3.0, 0.5])
NOISE = {"distance_floor": 0.1, "distance_slope": 0.2, "bearing_floor": 0.03, "bearing_slope": 0.05}


def beacons(**changed) -> mb.Beacons:
    given = {
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
    given = {"gravity": 3.0, "damping": 0.5}
    return mb.Pendulum(
        **given | {"process_noise": 0.3, "sensor_noise": 0.1, "anchor": 1.2} | changed
    )


def platform_problem(noise_convention: str = "intensity", **changes: object) -> mb.Problem:
    """Two coupled oscillators, gusts on both."""
    A = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-1, 0.3, -0.5, 0], [0.1, -1, 0, -0.5]])
    G = np.eye(4)[:, 2:]
    R = np.array([[5.0, 1.0], [1.0, 6.0]])
    system = mb.Steered(A, G, np.eye(2, 4), 0.5 * G, [0.3, 0.2], 1.0, **changes)
    cost = mb.GoalObstacleCost(np.zeros(4), np.ones(4), np.ones(4), R)
    return mb.Problem(
        system,
        cost,
        [0.3, 0, 0, 0.2],
        [0.4, 0.5, 0.5, 0.4],
        dt=0.1,
        steps=12,
        position=(0, 1),
        noise_convention=noise_convention,
    )
