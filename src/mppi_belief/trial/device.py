"""Selects what computes: the device of a configuration's platform, in the precision it asks for."""

import logging
import os
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import jax

from ..belief.integration import ManyNodesWarning
from ..errors import ConfigError, first_line
from ..numerics.jax_settings import pin_jax_settings

BACKEND_LOGGER = "jax._src.xla_bridge"  # logs why a plugin of JAX cannot be loaded


def device(config: dict[str, Any]) -> str:
    """Returns what JAX calls the device that this process computes on.

    Raises `ConfigError` if there is none of the configuration's platform or JAX chose another.
    """
    pin_jax_settings()
    platform = config["platform"]
    selected = f"JAX_PLATFORMS={os.environ.get('JAX_PLATFORMS', '')}"
    requirement = f"platform={platform}: {_requirement(platform)}; with {selected}"
    with _backend_messages() as messages:
        try:
            first_device = jax.devices()[0]
        except Exception as error:
            # Where there is no such device at all, JAX raises an assertion without words.
            text = str(error).partition(" (set JAX_PLATFORMS")[0]
            reasons = [*messages, text, "none is there"]
            reason = next(filter(None, reasons))
            raise ConfigError(f"{requirement}: {first_line(reason)}") from error
    if first_device.platform != platform:
        raise ConfigError(f"{requirement} JAX computes on the {first_device.platform}")
    return str(first_device.device_kind)


@contextmanager
def computing(config: dict[str, Any]) -> Iterator[None]:
    """Computes on the configuration's platform and in its precision.

    Raises `ConfigError` where that cannot be, see `device`.
    """
    device(config)
    with ExitStack() as settings:
        settings.enter_context(jax.enable_x64(config["precision"] == "float64"))
        settings.enter_context(warnings.catch_warnings())
        warnings.simplefilter("ignore", ManyNodesWarning)  # `check` has said it once for the run
        if config["platform"] == "gpu":
            # A GPU multiplies float32 matrices with a mantissa of 10 bits otherwise.
            settings.enter_context(jax.default_matmul_precision("highest"))
        yield


def _requirement(platform: str) -> str:
    """Returns what a platform needs."""
    if platform == "gpu":
        return 'needs an NVIDIA GPU and the extra "gpu": pip install ".[gpu]" in the checkout'
    return "needs JAX_PLATFORMS unset or cpu"


@contextmanager
def _backend_messages() -> Iterator[list[str]]:
    """Collects what JAX would log while it looks for devices.

    A plugin that fails is logged with a traceback, even if its platform is not wanted.
    """
    messages: list[str] = []

    def collect(record: logging.LogRecord) -> bool:
        messages.append(str(record.exc_info[1]) if record.exc_info else record.getMessage())
        return False

    logger = logging.getLogger(BACKEND_LOGGER)
    logger.addFilter(collect)
    try:
        yield messages
    finally:
        logger.removeFilter(collect)
