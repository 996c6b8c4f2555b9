"""A controller as a user might write it, on which one trial is unlucky; named by a yaml beside this
file.
"""

import ctypes
import os
import signal
import time
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import mppi_belief as mb
from mppi_belief.simulate import PLANNER, role_key


class Info(NamedTuple):
    ess: Array


def suffer(fate: str) -> np.float32:
    """Does on the host what the unlucky trial suffers."""
    if fate == "raises":
        raise ValueError("this trial is cursed")
    if fate == "kills":
        os.kill(os.getpid(), signal.SIGKILL)
    if fate == "hangs":
        time.sleep(3600)
    if fate == "holds":  # and lets no other thread of Python look at the clock
        ctypes.PyDLL(None).sleep(3600)
    return np.float32(0)


@mb.struct
class Unlucky:
    """u = -mean / 2, until the first step of one trial of seed 0."""

    fate: str = mb.choice(
        "nothing",
        "calls",  # back to the host, where nothing happens
        "raises",
        "kills",
        "hangs",
        "holds",
        "becomes_nan",
        "becomes_inf",
        default="nothing",
    )
    trial: int = mb.size(default=3, ge=0)

    def init(self, problem: mb.Problem) -> tuple[()]:
        return ()

    def act(
        self, problem: mb.Problem, belief: mb.Belief, plan: tuple[()], key: Array
    ) -> tuple[Array, tuple[()], Info]:
        u = -0.5 * belief.mean
        theirs = jax.random.fold_in(role_key(0, self.trial, PLANNER), 0)
        now = jnp.all(jax.random.key_data(key) == jax.random.key_data(theirs))
        if self.fate.startswith("becomes_"):
            u = jnp.where(now, float(self.fate.removeprefix("becomes_")), u)
        elif self.fate != "nothing":
            shape = jax.ShapeDtypeStruct((), jnp.float32)
            u = u + jax.lax.cond(
                now, lambda: jax.pure_callback(lambda: suffer(self.fate), shape), lambda: 0.0
            )
        return u, plan, Info(jnp.ones(()))
