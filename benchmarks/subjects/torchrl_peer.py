"""Adapts TorchRL's `MPPIPlanner`, a planner that searches in a model-based environment.

It is set up as in its docstring: a `ModelBasedEnvBase` around a world model of `TensorDictModule`s,
an advantage module, one optimisation step (as the others), and all candidates are used. Actions are
in units of the spread, since it samples with unit variance. The advantage is the return less the
best one, which keeps its exponentials finite; a plain sum is faster than the `TDLambdaEstimator` of
the docstring, and the same for gamma = lambda = 1. `torch.inference_mode()` is on; `torch.compile`
breaks off at the environment's rollout and gains nothing. It plans from a zero nominal at each
step: it has no warm start and no importance term, so the control cost is charged.
"""

from importlib.metadata import version

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule
from torchrl.data import Composite, Unbounded
from torchrl.envs.model_based import ModelBasedEnvBase
from torchrl.modules import MPPIPlanner, WorldModelWrapper

from plant import Planner, Workload


def make(name: str, workload: Workload, dtype: str) -> Planner:
    """Returns the planner."""
    return TorchRL(workload, dtype)


class Env(ModelBasedEnvBase):
    """Represents the double integrator as an environment, for any batch of states and actions."""

    def __init__(self, world_model: WorldModelWrapper, real: torch.dtype) -> None:
        super().__init__(world_model, device="cpu", batch_size=torch.Size([]))
        self.state_spec = Composite(x=Unbounded((4,), dtype=real))
        self.observation_spec = Composite(x=Unbounded((4,), dtype=real))
        self.action_spec = Unbounded((2,), dtype=real)
        self.reward_spec = Unbounded((1,), dtype=real)

    def _reset(self, tensordict: TensorDictBase, **_: object) -> TensorDictBase:
        return TensorDict({"x": torch.zeros(4)}, batch_size=self.batch_size)


class Advantage(torch.nn.Module):
    """Computes the return of each candidate less the best one's, terminal cost included."""

    def __init__(self, terminal: object) -> None:
        super().__init__()
        self.terminal = terminal

    def forward(self, paths: TensorDictBase) -> TensorDictBase:
        """Adds the advantage to a batch of paths."""
        returns = paths["next", "reward"].sum(-2) - self.terminal(paths["next", "x"][..., -1, :])
        advantage = returns - returns.max()
        return paths.set("advantage", advantage.unsqueeze(-2).expand(*paths.shape, 1))


class TorchRL(Planner):
    """Implements MPPI by TorchRL's `MPPIPlanner`."""

    settings = "MPPIPlanner, one optimisation step, eager"

    def __init__(self, workload: Workload, dtype: str) -> None:
        super().__init__(workload, dtype)
        torch.set_num_threads(1)
        torch.manual_seed(0)
        self.versions = {name: version(name) for name in ("torchrl", "tensordict", "torch")}
        self.real = getattr(torch, dtype)
        dynamics, reward, terminal = functions(workload, self.real)
        world = WorldModelWrapper(
            TensorDictModule(dynamics, in_keys=["x", "action"], out_keys=["x"]),
            TensorDictModule(reward, in_keys=["x", "action"], out_keys=["reward"]),
        )
        self.planner = MPPIPlanner(
            Env(world, self.real),
            Advantage(terminal),
            temperature=1 / workload["temperature"],
            planning_horizon=workload["horizon"],
            optim_steps=1,
            num_candidates=workload["n_samples"],
            top_k=workload["n_samples"],
        )

    def reset(self) -> None:
        """Does nothing: the planner keeps nothing between steps."""

    def observe(self, x: list[float]) -> TensorDict:
        return TensorDict({"x": torch.tensor(x, dtype=self.real)}, batch_size=[])

    def act(self, state: TensorDict) -> torch.Tensor:
        with torch.inference_mode():
            return self.planner(state)["action"]

    def control(self, result: torch.Tensor) -> list[float]:
        return (self.workload["control_std"] * result).tolist()


def functions(workload: Workload, real: torch.dtype) -> tuple:
    """Returns next state and reward of states (..., 4), actions (..., 2), and the terminal cost."""
    dt = workload["dt"]
    std = workload["control_std"]
    names = ("goal", "running_weight", "terminal_weight", "centers", "control_weight")
    goal, weight, last_weight, centers, R = (
        torch.tensor(workload[name], dtype=real) for name in names
    )

    def dynamics(x: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
        return x + dt * torch.cat([x[..., 2:], std * action], dim=-1)

    def reward(x: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
        apart = (x[..., None, :2] - centers).square().sum(-1)
        bumps = torch.exp(-0.5 / workload["bump_width"] ** 2 * apart).sum(-1)
        rate = 0.5 * (x - goal).square() @ weight + workload["w_obs"] * bumps
        return -dt * (rate + 0.5 * std**2 * action.square() @ R).unsqueeze(-1)

    def terminal(x: torch.Tensor) -> torch.Tensor:
        return (0.5 * (x - goal).square() @ last_weight).unsqueeze(-1)

    return dynamics, reward, terminal
