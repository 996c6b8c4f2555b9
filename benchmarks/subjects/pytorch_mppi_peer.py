"""Adapts pytorch_mppi: MPPI in PyTorch, eager and with its `compile()`.

`MPPI` is set up as in its README: functions are batched over samples, the state is already a
tensor, and there is one thread. The compiled planner calls `MPPI.compile()`, which its docstring
advises "for reduced kernel launch overhead": `torch.compile` of dynamics and running cost. Both run
under `torch.inference_mode()`. Its importance term is lambda nominal' Sigma^-1 eps. By default it
starts from a random nominal; here it starts from zero, as the others do.
"""

from importlib.metadata import version

import torch
from pytorch_mppi import MPPI

from plant import Planner, Workload


def make(name: str, workload: Workload, dtype: str) -> Planner:
    """Returns the eager or the compiled planner."""
    return PytorchMppi(workload, dtype, compiled=name == "pytorch_mppi_compiled")


class PytorchMppi(Planner):
    """Implements MPPI by `pytorch_mppi.MPPI`."""

    def __init__(self, workload: Workload, dtype: str, compiled: bool) -> None:
        super().__init__(workload, dtype)
        torch.set_num_threads(1)
        torch.manual_seed(0)
        self.settings = "MPPI.compile()" if compiled else "eager"
        self.versions = {name: version(name) for name in ("pytorch-mppi", "torch")}
        self.real = getattr(torch, dtype)
        self.none = torch.zeros(workload["horizon"], 2, dtype=self.real)
        dynamics, running, terminal = functions(workload, self.real)
        self.planner = MPPI(
            dynamics,
            running,
            4,
            torch.eye(2, dtype=self.real) * workload["control_std"] ** 2,
            num_samples=workload["n_samples"],
            horizon=workload["horizon"],
            terminal_state_cost=terminal,
            lambda_=workload["temperature"],
            U_init=self.none.clone(),
        )
        if compiled:
            self.planner.compile()

    def reset(self) -> None:
        self.planner.U = self.none.clone()

    def observe(self, x: list[float]) -> torch.Tensor:
        return torch.tensor(x, dtype=self.real)

    def act(self, state: torch.Tensor) -> torch.Tensor:
        with torch.inference_mode():
            return self.planner.command(state)

    def control(self, result: torch.Tensor) -> list[float]:
        return result.tolist()


def functions(workload: Workload, real: torch.dtype) -> tuple:
    """Returns dynamics and running cost of states (K, 4) and actions (K, 2), and the terminal cost.

    The terminal cost takes states (1, K, T, 4).
    """
    dt = workload["dt"]
    width = workload["bump_width"]
    names = ("goal", "running_weight", "terminal_weight", "centers")
    goal, weight, last_weight, centers = (
        torch.tensor(workload[name], dtype=real) for name in names
    )

    def dynamics(x: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
        return x + dt * torch.cat([x[:, 2:], u], dim=-1)

    def running(x: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
        apart = (x[:, None, :2] - centers).square().sum(-1)
        bumps = torch.exp(-0.5 / width**2 * apart).sum(-1)
        return dt * (0.5 * (x - goal).square() @ weight + workload["w_obs"] * bumps)

    def terminal(states: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        return 0.5 * (states[..., -1, :] - goal).square() @ last_weight

    return dynamics, running, terminal
