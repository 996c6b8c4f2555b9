"""A controller that takes its time without a processor, and on which trial 3 of seed 0 may be
unlucky.
"""

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

UNLUCKY = 3


class Info(NamedTuple):
    ess: Array


def wait(nap: float, fate: str, now: bool) -> np.float32:
    """Does on the host what happens at a step; `now` at the first one of the unlucky trial."""
    if now and fate == "kills":
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(3600 if now and fate == "hangs" else nap)
    return np.float32(0)


@mb.struct
class Patient:
    """u = -mean / 2, after a nap."""

    nap: float = mb.number(default=0.03, ge=0)
    fate: str = mb.choice("nothing", "kills", "hangs", default="nothing")

    def init(self, problem: mb.Problem) -> tuple[()]:
        return ()

    def act(
        self, problem: mb.Problem, belief: mb.Belief, plan: tuple[()], key: Array
    ) -> tuple[Array, tuple[()], Info]:
        theirs = jax.random.fold_in(role_key(0, UNLUCKY, PLANNER), 0)
        now = jnp.all(jax.random.key_data(key) == jax.random.key_data(theirs))
        shape = jax.ShapeDtypeStruct((), jnp.float32)
        slept = jax.pure_callback(
            lambda nap, now: wait(float(nap), self.fate, bool(now)), shape, self.nap, now
        )
        return -0.5 * belief.mean + slept, plan, Info(jnp.ones(()))
