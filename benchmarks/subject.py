"""Runs a contestant in a process of its own: JSON lines in, JSON lines out.

    python benchmarks/subject.py MODULE NAME CPU

    {"do": "prepare", "workload": {...}, "dtype": "float32"}
                                 ->  {"versions": {...}, "settings": "..."}
    {"do": "time", "calls": 40}  ->  {"seconds": [...]}
    {"do": "closed_loop"}        ->  {"nearest": m, "final_distance": m, "clearance": m}
    {"do": "quit"}               ->  {}

A request that failed is answered by {"error": "what happened"}. MODULE is one of `subjects`; its
`make(name, workload, dtype)` returns an object like `plant.Planner`. Only the standard library is
used.
"""

import importlib
import json
import os
import sys
import traceback
from collections.abc import Callable
from typing import Any, TextIO


def answer(
    make: Callable[..., Any], name: str, request: dict[str, Any], planners: dict[str, Any]
) -> dict[str, Any]:
    """Returns the reply to one request; `planners` keeps the planner between requests."""
    match request["do"]:
        case "prepare":
            planner = planners["planner"] = make(name, request["workload"], request["dtype"])
            return {"versions": planner.versions, "settings": planner.settings}
        case "time":
            return {"seconds": planners["planner"].time(request["calls"])}
        case "closed_loop":
            return planners["planner"].closed_loop()
        case unknown:
            raise ValueError(f"unknown request {unknown!r}")


def serve(make: Callable[..., Any], name: str, requests: TextIO, replies: TextIO) -> None:
    """Answers requests until one says quit or there are no more."""
    planners: dict[str, Any] = {}
    for line in requests:
        request = json.loads(line)
        if request["do"] == "quit":
            reply: dict[str, Any] = {}
        else:
            try:
                reply = answer(make, name, request, planners)
            except Exception as error:
                traceback.print_exc()
                reply = {"error": f"{type(error).__name__}: {error}"}
        replies.write(json.dumps(reply) + "\n")
        replies.flush()
        if request["do"] == "quit":
            return


def main() -> None:
    """Pins the process to its CPU, imports the module and serves.

    What a library prints goes to stderr, so that stdout holds replies only.
    """
    module, name, cpu = sys.argv[1:]
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {int(cpu)})
    replies = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)

    def make(*args: Any) -> Any:
        return importlib.import_module(f"subjects.{module}").make(*args)

    serve(make, name, sys.stdin, replies)


if __name__ == "__main__":
    main()
