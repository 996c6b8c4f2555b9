"""Brings the position to the front of the state, where all pictures look for it."""

from typing import Any

import numpy as np
import pandas as pd


def position_first(
    steps: pd.DataFrame, scene: dict[str, Any] | None
) -> tuple[pd.DataFrame, dict[str, Any] | None]:
    """Returns steps and scene of trials with the position as the first components of the state.

    `steps` has columns state (nx,), mean (nx,) and cov (nx nx,); `scene["position"]` says which
    components the position is. Both come back as they are where it leads already.
    """
    position = (scene or {}).get("position", [])
    if scene is None or steps.empty or position == list(range(len(position))):
        return steps, scene
    nx = len(steps["state"].iloc[0])
    order = [*position, *(i for i in range(nx) if i not in position)]
    block = np.ix_(order, order)
    states: Any = [np.asarray(state)[order] for state in steps["state"]]
    means: Any = [np.asarray(mean)[order] for mean in steps["mean"]]
    covs: Any = [np.reshape(cov, (nx, nx))[block].ravel() for cov in steps["cov"]]
    reordered = steps.assign(state=states, mean=means, cov=covs)
    return reordered, scene | {"position": list(range(len(position)))}
