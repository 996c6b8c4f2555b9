"""Describes the choices that the paper leaves open beside its numbers, and writes them to a cell.

They are discrete: the shape of the obstacle penalty, how its expectation and its variance are
computed, which of true start and first mean is drawn, and so on (`CHOICES`). A candidate of the
search is one choice of each with one value of every open number (`scenario.OPEN`).
"""

from typing import Any

CHOICES: dict[str, tuple[Any, ...]] = {
    "penalty": ("hinge", "squared_hinge", "smooth_step", "indicator", "bump"),
    "expectation": ("at_mean", "exact", "sigma_points"),  # of the penalty
    "variance": ("sigma_points", "exact", "delta"),
    "variance_of": ("penalty", "total"),
    "sigma_point_spread": (3.0, 4.0),  # c; 4 is the cubature rule of four states
    "initial_draw": ("none", "mean", "state"),  # what the prior's spread is drawn for
    "sampling": ("free", "matched"),  # spread of controls: open, or sqrt(lambda R^-1 / dt)
    "at_step_end": (True, False),
    "steps": (40, 50, 60, 80, 100),
}
PENALTIES = {
    "hinge": "mppi_belief.Hinge",
    "squared_hinge": "mppi_belief.SquaredHinge",
    "smooth_step": "mppi_belief.SmoothStep",
    "indicator": "mppi_belief.Indicator",
    "bump": "mppi_belief.Bump",
}
BUMPS = {  # the structure of the first calibration
    "penalty": "bump",
    "expectation": "exact",
    "variance": "exact",
    "variance_of": "penalty",
    "sigma_point_spread": 4.0,
    "initial_draw": "state",
    "sampling": "free",
    "at_step_end": True,
    "steps": 60,
}
MARGIN = BUMPS | {  # acts as a margin of two standard deviations, as the paper's sweeps suggest
    "penalty": "hinge",
    "expectation": "at_mean",
    "variance": "sigma_points",
    "initial_draw": "mean",
}


def set_structure(config: dict[str, Any], candidate: dict[str, Any]) -> None:
    """Writes the choices of a candidate into a method's configuration."""
    config["problem"] |= {
        "initial_draw": candidate["initial_draw"],
        "steps": candidate["steps"],
    }
    config["cost"]["obstacle_penalty"] = _penalty(candidate)

    controller = config["controller"]
    path_cost = controller.get("path_cost", controller)
    path_cost["at_step_end"] = candidate["at_step_end"]
    if "theta" in path_cost:
        names = ("expectation", "variance", "variance_of", "sigma_point_spread")
        path_cost |= {name: candidate[name] for name in names}
    if "control_std" in controller.get("sampler", {}):
        matched = candidate["sampling"] == "matched"
        controller["sampler"]["control_std"] = None if matched else candidate["control_std"]


def _penalty(candidate: dict[str, Any]) -> dict[str, Any]:
    """Returns the node of the obstacle penalty: its class, and its width or margin (m)."""
    kind = candidate["penalty"]
    size = {"width": candidate["width"]} if kind == "bump" else {"margin": candidate["margin"]}
    return {"_target_": PENALTIES[kind], **size}


def shown(value: Any) -> str:
    """Returns a choice or a number as the log has it."""
    return f"{value:.5g}" if type(value) is float else str(value)
