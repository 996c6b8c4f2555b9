"""Collects what JAX reports of its work: the functions that it traces and compiles."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import jax

TRACED = "jaxpr_trace_duration"
COMPILED = "backend_compile_duration"


@contextmanager
def collect_events(event: str) -> Iterator[list[str]]:
    """Collects the functions that JAX traces or compiles; one found in a cache counts, too."""
    names: list[str] = []

    def listen(name: str, seconds: float, **about: Any) -> None:
        if name.rpartition("/")[2] == event:
            names.append(about.get("fun_name", "?"))

    jax.monitoring.register_event_duration_secs_listener(listen)
    try:
        yield names
    finally:
        jax.monitoring.unregister_event_duration_listener(listen)
