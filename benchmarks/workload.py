"""Describes the work of Sec. VII in plain numbers, for libraries that do not know this package."""

from typing import Any

from mppi_belief.config.compose import collect
from mppi_belief.config.conf_files import conf_dir
from mppi_belief.config.request import Request

STUDY = "table_1_bumps"
# A commit that does not have the study yet has its numbers as defaults.
SCENE = (f"experiment={STUDY}",) if (conf_dir() / "experiment" / f"{STUDY}.yaml").is_file() else ()


def workload(overrides: list[str] | None = None) -> dict[str, Any]:
    """Returns dynamics, costs and sampling of `controller=ce`: SI units, diagonal weights.

    The penalty is that of the first calibration, Gaussian bumps, which every library can have.
    """
    (config,) = collect(Request((*SCENE, "controller=ce", *(overrides or []))))
    cost = config["cost"]
    problem = config["problem"]
    planner = config["controller"]
    obstacles = problem["obstacles"]
    return {
        "dt": problem["dt"],
        "steps": problem["steps"],
        "start": problem["prior_mean"],
        **{
            name: cost[name]
            for name in ("goal", "running_weight", "terminal_weight", "control_weight")
        },
        "w_obs": cost["w_obs"],
        "bump_width": cost["obstacle_penalty"]["width"],
        **{name: obstacles[name] for name in ("centers", "radius")},
        **{name: planner[name] for name in ("n_samples", "horizon", "temperature")},
        "control_std": planner["sampler"]["control_std"],
    }
