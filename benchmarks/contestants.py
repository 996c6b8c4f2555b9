"""Who is measured: ours, their floors, the peers."""

from collections.abc import Sequence
from typing import NamedTuple

BOTH = ("float32", "float64")
DOUBLE = ("float64",)


class Contestant(NamedTuple):
    """A name of the command line; `module` of `subjects`, `environment` of `environments` (None: this package's),
    `floor`: the floor of one of ours, `beside`: which of ours it is compared with."""

    name: str
    kind: str
    label: str
    module: str = "ours"
    environment: str | None = None
    dtypes: tuple[str, ...] = BOTH
    floor: str | None = None
    beside: str = "ce"


CONTESTANTS = (
    Contestant("ce", "ours", "CE-MPPI", floor="floor_ce"),
    Contestant("belief", "ours", "MPPI-Belief", floor="floor_belief"),
    Contestant("belief_joint", "ours", "MPPI-Belief, a covariance a path"),
    Contestant("pipf", "ours", "PIPF (50 x 200 samples)", floor="floor_pipf"),
    Contestant("ilqg", "ours", "EKF-iLQG"),
    Contestant("normals", "floors", "normals of all samples", "floors"),
    Contestant("rollout", "floors", "bare rollouts", "floors"),
    Contestant("schedule", "floors", "one schedule of covariances", "floors"),
    Contestant("floor_ce", "floors", "normals and rollouts", "floors"),
    Contestant("floor_belief", "floors", "normals and rollouts and schedule", "floors"),
    Contestant("floor_pipf", "floors", "PIPF's normals and rollouts", "floors"),
    Contestant("faran_jax", "peers", "faran (JAX)", "faran_peer", "faran"),
    Contestant("faran_jax_one_jit", "peers", "faran (JAX, in one jit)", "faran_peer", "faran"),
    Contestant("faran_numpy", "peers", "faran (NumPy)", "faran_peer", "faran", DOUBLE),
    Contestant("jax_mppi", "peers", "jax_mppi", "jax_mppi_peer", "jax_mppi"),
    Contestant("pytorch_mppi", "peers", "pytorch_mppi (eager)", "pytorch_mppi_peer", "torch"),
    Contestant(
        "pytorch_mppi_compiled", "peers", "pytorch_mppi (compile())", "pytorch_mppi_peer", "torch"
    ),
    Contestant("torchrl", "peers", "TorchRL MPPIPlanner", "torchrl_peer", "torch"),
    Contestant(
        "crocoddyl",
        "peers",
        "crocoddyl SolverDDP",
        "crocoddyl_peer",
        "crocoddyl",
        DOUBLE,
        beside="ilqg",
    ),
)
KINDS = {"ours": "Ours", "floors": "Floors", "peers": "Peers"}


def choose(words: Sequence[str], among: Sequence[Contestant] = CONTESTANTS) -> list[Contestant]:
    """The contestants that `words` name, by name, kind or environment, in the order of the list; all without words.

    Raises `SystemExit` for a word that names none.
    """
    for word in words:
        if not any(word in _names(one) for one in among):
            raise SystemExit(
                f"{word}: not one of {', '.join([*KINDS, *(one.name for one in among)])}"
            )
    return [one for one in among if not words or any(word in _names(one) for word in words)]


def _names(one: Contestant) -> tuple[str | None, ...]:
    return one.name, one.kind, one.environment
