"""Lists who is measured: our controllers, their floors, and the peers."""

from collections.abc import Sequence
from typing import NamedTuple

BOTH = ("float32", "float64")
DOUBLE = ("float64",)


class Contestant(NamedTuple):
    """Represents a program that is measured."""

    name: str  # on the command line
    kind: str  # a key of `KINDS`
    label: str  # in the table
    module: str = "ours"  # of `subjects`
    environment: str | None = None  # of `environments`; None: this package's own
    dtypes: tuple[str, ...] = BOTH
    floor: str | None = None  # the name of the floor of one of ours
    beside: str = "ce"  # the name of ours that it is compared with


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
    """Returns the contestants that `words` name, in the order of the list.

    Without words all are returned. A word is the name of a contestant, a kind or an
    environment; raises `SystemExit` for any other.
    """
    for word in words:
        if not any(word in _names(contestant) for contestant in among):
            known = ", ".join([*KINDS, *(contestant.name for contestant in among)])
            raise SystemExit(f"{word}: not one of {known}")
    return [
        contestant
        for contestant in among
        if not words or any(word in _names(contestant) for word in words)
    ]


def _names(contestant: Contestant) -> tuple[str | None, ...]:
    """Returns the words by which a contestant can be chosen."""
    return contestant.name, contestant.kind, contestant.environment
