"""Names in a message the key that a person has written.

`controller.horizon` is `${planner.horizon}` in conf/. A controller knows its own field alone, so
the message about planner.horizon=0 would speak of controller.horizon.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from omegaconf import OmegaConf

from ..errors import ConfigError, FieldError
from .compose import jobs
from .request import Request
from .studies import grids

REFERENCE = re.compile(r"\$\{(?P<key>\w[\w.]*)\}")  # a value that is the value of another key


@contextmanager
def written_keys(request: Request) -> Iterator[None]:
    """Turns a `FieldError` about a key of a request's cells into one about the key it refers to."""
    try:
        yield
    except FieldError as error:
        raise ConfigError(f"{_source_of(request, error.key)}{error.reason}") from error


def _source_of(request: Request, key: str) -> str:
    """Returns what a key refers to in the first job that has it, or else the key itself."""
    for grid in grids(request):
        for job in jobs(grid):
            source = _followed(OmegaConf.to_container(job.config, resolve=False), key)
            if source is not None:
                return source
    return key


def _followed(config: Any, key: str) -> str | None:
    """Returns the last key of a chain of references; None where the key does not exist."""
    node = config
    for part in key.split("."):
        if not isinstance(node, dict) or part not in node:
            return None
        node = node[part]
    reference = REFERENCE.fullmatch(node) if isinstance(node, str) else None
    return _followed(config, reference["key"]) if reference else key
