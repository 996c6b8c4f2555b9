"""The grids of a study: one request for each yaml file that the study consists of."""

import dataclasses
from pathlib import Path

from omegaconf import OmegaConf

from ..errors import ConfigError
from .conf_files import conf_dir
from .hydra_errors import config_error_line
from .request import Request, key_of
from .yaml_files import SWEPT, read_yaml


def grids(request: Request) -> list[Request]:
    """Returns one request for each grid of a study NAME: NAME.yaml, then every NAME.*.yaml beside
    it.

    A grid crosses all that it sweeps, so methods whose settings are different keys need a grid
    each. A request that sets a key which NAME.yaml sweeps asks for a part of that grid, and for no
    other.
    """
    for position, override in enumerate(request.overrides):
        group, _, study = override.partition("=")
        if group != "experiment":
            continue
        files = _study_files(request)
        keys = {key_of(word) for word in request.overrides}
        if study not in files or swept_keys(files[study]) & keys:
            return [request]
        names = [study, *(name for name in sorted(files) if name.startswith(f"{study}."))]
        before = request.overrides[:position]
        after = request.overrides[position + 1 :]
        return [
            dataclasses.replace(request, overrides=(*before, f"experiment={name}", *after))
            for name in names
        ]
    return [request]


def swept_keys(path: Path) -> set[str]:
    """Returns the keys that a study's file sweeps."""
    try:
        return set(OmegaConf.select(OmegaConf.create(read_yaml(path)), SWEPT) or ())
    except Exception as error:
        raise ConfigError(config_error_line(error)) from error


def _study_files(request: Request) -> dict[str, Path]:
    """Returns the file of every study by its name; as in Hydra, conf/ comes before the folders of
    --config-dir.
    """
    files: dict[str, Path] = {}
    for folder in reversed([conf_dir(), *map(Path, request.config_dirs)]):
        files |= {path.stem: path for path in sorted((folder / "experiment").glob("*.yaml"))}
    return files
