"""Composes the studies that a `report` command asks for, and tells the user's from the paper's."""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

from ..config.cell import Cell
from ..config.compose import collect
from ..config.request import Request, key_of
from ..config.settings import DESCRIPTION_KEYS, RUNTIME_KEYS
from ..report import build
from ..report.cell_results import METHOD_NAMES
from ..report.paper_settings import Configuration, are_part_of
from ..report.reported_study import ReportedStudy
from ..report.wording import listed

STUDY = "experiment="
SWEEP = "sweep"  # the stem of the files of a sweep of the command line
COMPUTED_KEYS = ("seed", "platform", "precision", "batch")  # change a cell, but not its problem


class ReportedStudies(NamedTuple):
    """Holds the studies of a report, and what it needs to compare them with the paper's."""

    studies: list[ReportedStudy]
    table_1: list[Configuration]  # of conf/experiment/table_1.yaml; empty where none is compared
    settings: dict[str, Any]  # the top level of the first configuration


def asks_for_a_sweep(request: Request) -> bool:
    """Returns whether a request without studies is for cells of its own, as `run` would run them.

    It is, unless it only says how the paper's studies are computed and where their files lie.
    """
    keys = {key_of(word).split(".")[0] for word in request.overrides}
    computed = keys & set(COMPUTED_KEYS)
    return bool(keys - {*RUNTIME_KEYS, *COMPUTED_KEYS}) or (request.multirun and bool(computed))


def study_requests(chosen: Sequence[str], request: Request) -> dict[str, Request]:
    """Returns the request of each study by its name, or of the sweep of the command line."""
    if not chosen and asks_for_a_sweep(request):
        return {SWEEP: request}
    return {
        name: dataclasses.replace(request, overrides=(f"{STUDY}{name}", *request.overrides))
        for name in chosen or (*build.STUDIES, *build.SUPPLEMENTARY)
    }


def compose_studies(requests: dict[str, Request], request: Request) -> ReportedStudies:
    """Composes the studies of some requests; `request` is the command's, without its studies.

    Raises `ConfigError`.
    """
    configs = {name: collect(study) for name, study in requests.items()}
    studies = [_reported_study(name, requests[name], request, configs[name]) for name in requests]
    papers = (*build.STUDIES, *build.SUPPLEMENTARY)
    is_compared = any(study.name in papers and not study.is_own for study in studies)
    table_1 = collect(Request(overrides=(f"{STUDY}table_1",))) if is_compared else []
    return ReportedStudies(studies, table_1, next(iter(configs.values()))[0])


def _reported_study(
    name: str, study: Request, request: Request, configs: list[dict[str, Any]]
) -> ReportedStudy:
    """Returns one study; its own are title, question and files unless a section knows its cells."""
    is_own = not _is_known(name, request, configs)
    is_changed = is_own and name in build.SECTIONS
    descriptions = {
        key: next((str(config[key]) for config in configs if config[key]), "")
        for key in DESCRIPTION_KEYS
    }
    title = name
    if name in (SWEEP, "none"):
        title = sweep_title(configs)
    elif is_changed:
        title = f"{name} with {' '.join(request.overrides)}" if request.overrides else name
    return ReportedStudy(
        name=name,
        cells=[Cell(config) for config in configs],
        words=tuple(study.words),
        overrides=tuple(request.words),
        is_own=is_own,
        stem=f"{name}_changed" if is_changed else name.replace("/", "_"),
        title=descriptions["title"] or title,
        question=descriptions["question"],
    )


def _is_known(name: str, request: Request, configs: Sequence[Configuration]) -> bool:
    """Returns whether the report has a section for a study, and the cells are those of conf/."""
    if name not in build.SECTIONS:
        return False
    if not asks_for_a_sweep(request) and not request.config_dirs:
        return True
    return are_part_of(configs, collect(Request(overrides=(f"{STUDY}{name}",))))


def sweep_title(configs: Sequence[Configuration]) -> str:
    """Returns the title of a sweep without a yaml: systems, or controllers, and the swept keys."""
    systems = list(dict.fromkeys(config["names"]["system"] for config in configs))
    methods = list(dict.fromkeys(config["names"]["controller"] for config in configs))
    names = [METHOD_NAMES.get(method, method) for method in methods]
    keys = dict.fromkeys(key for config in configs for key in config["swept"])
    swept = [
        key
        for key in keys
        if key not in ("system", "controller")
        and len({str(config["swept"].get(key)) for config in configs}) > 1
    ]
    title = f"{listed(names)} on {listed(systems)}"
    return f"{title} by {listed(swept)}" if swept else title
