"""A contestant in a process of its own: JSON lines in, JSON lines out.

    python benchmarks/subject.py MODULE NAME CPU

    {"do": "prepare", "workload": {...}, "dtype": "float32"}  ->  {"versions": {...}, "settings": "..."}
    {"do": "time", "calls": 40}                               ->  {"seconds": [...]}
    {"do": "closed_loop"}                                     ->  {"nearest": m, "final_distance": m, "clearance": m}
    {"do": "quit"}                                            ->  {}

Every reply that failed is {"error": "what happened"}. MODULE is one of `subjects`, whose `make(name, workload, dtype)`
gives an object like `plant.Planner`. Standard library only.
"""

import importlib
import json
import os
import sys
import traceback
from collections.abc import Callable
from typing import Any, TextIO


def answer(
    make: Callable[..., Any], name: str, request: dict[str, Any], made: dict[str, Any]
) -> dict[str, Any]:
    """The reply to one request; `made` keeps the planner between requests."""
    match request["do"]:
        case "prepare":
            planner = made["planner"] = make(name, request["workload"], request["dtype"])
            return {"versions": planner.versions, "settings": planner.settings}
        case "time":
            return {"seconds": made["planner"].time(request["calls"])}
        case "closed_loop":
            return made["planner"].closed_loop()
        case other:
            raise ValueError(f"unknown request {other!r}")


def serve(make: Callable[..., Any], name: str, requests: TextIO, replies: TextIO) -> None:
    """Answer until told to quit or nobody asks any more."""
    made: dict[str, Any] = {}
    for line in requests:
        request = json.loads(line)
        if request["do"] == "quit":
            reply: dict[str, Any] = {}
        else:
            try:
                reply = answer(make, name, request, made)
            except Exception as error:
                traceback.print_exc()
                reply = {"error": f"{type(error).__name__}: {error}"}
        replies.write(json.dumps(reply) + "\n")
        replies.flush()
        if request["do"] == "quit":
            return


def main() -> None:
    """Pin, import, serve; what a library prints goes to stderr, so that replies stay alone on stdout."""
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
