"""What computes: the device that a configuration's platform names, in the precision it asks for."""

import logging
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import jax

from ..errors import ConfigError
from ..numerics.dispatch import compute_in_calling_thread


def device(config: dict[str, Any]) -> str:
    """What JAX calls the device that this process computes on; raises `ConfigError` if its platform is another."""
    compute_in_calling_thread()
    wanted, chosen = config["platform"], f"JAX_PLATFORMS={os.environ.get('JAX_PLATFORMS', '')}"
    with _heard() as said:
        try:
            found = jax.devices()[0]
        except (
            Exception
        ) as error:  # an assertion without words where there is no such device at all
            reason = [*said, str(error).partition(" (set JAX_PLATFORMS")[0], "none is there"]
            line = next(filter(None, reason)).partition("\n")[0]
            raise ConfigError(
                f"platform={wanted}: {_needed(wanted)}; with {chosen}: {line}"
            ) from error
    if found.platform != wanted:
        raise ConfigError(
            f"platform={wanted}: {_needed(wanted)}; with {chosen} JAX computes on the {found.platform}"
        )
    return str(found.device_kind)


@contextmanager
def _heard() -> Iterator[list[str]]:
    """What JAX would log while it looks for devices: a plugin that fails is a traceback there, even if not wanted."""
    said: list[str] = []

    def keep(record: logging.LogRecord) -> bool:
        said.append(str(record.exc_info[1]) if record.exc_info else record.getMessage())
        return False

    logger = logging.getLogger("jax._src.xla_bridge")
    logger.addFilter(keep)
    try:
        yield said
    finally:
        logger.removeFilter(keep)


def _needed(platform: str) -> str:
    if platform == "gpu":
        return 'needs an NVIDIA GPU and pip install "mppi-belief[gpu]"'
    return "needs JAX_PLATFORMS unset or cpu"


@contextmanager
def computing(config: dict[str, Any]) -> Iterator[None]:
    """Compute on the configuration's platform and in its precision; raises `ConfigError`, see `device`."""
    device(config)
    with ExitStack() as settings:
        settings.enter_context(jax.enable_x64(config["precision"] == "float64"))
        if config["platform"] == "gpu":  # which multiplies float32 matrices with 10 bits otherwise
            settings.enter_context(jax.default_matmul_precision("highest"))
        yield
