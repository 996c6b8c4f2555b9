"""Prints what a request would compose: its configuration, the files it comes from, all groups and
keys.
"""

from omegaconf import OmegaConf

from ..config.compose import first_job
from ..config.conf_files import conf_dir, file_of, groups
from ..config.request import Request


def wants_printing(request: Request) -> bool:
    """Returns whether a request asks for its configuration instead of for work."""
    return request.print_configuration or request.print_sources


def show(request: Request) -> int:
    """Prints what a request with `--cfg` or `--info` asks for; returns the exit code 0."""
    if request.print_configuration:
        print(configuration(request), end="")
    if request.print_sources:
        print(sources(request), end="")
    return 0


def configuration(request: Request) -> str:
    """Returns the configuration of a request's first job as yaml."""
    return OmegaConf.to_yaml(first_job(request).config, resolve=request.resolve)


def sources(request: Request) -> str:
    """Returns a line for the main file and for the chosen option of each group: group, option,
    file.
    """
    lines = [f"{'config':24}{'':24}{conf_dir() / 'config.yaml'}"]
    for group, option in sorted(first_job(request).options.items()):
        path = file_of(group, option, request.config_dirs) if option else None
        lines.append(f"{group:24}{option or '-':24}{path or '-'}")
    return "\n".join(lines) + "\n"


def groups_and_keys(request: Request) -> str:
    """Returns what `run --help` says of groups and keys, with the values that the request gives
    them.
    """
    lines = ["Groups: choose an option with GROUP=OPTION"]
    lines += [
        f"{group}: {', '.join(options)}" for group, options in groups(request.config_dirs).items()
    ]
    lines += ["", "Keys and their values: set with KEY=VALUE, nested ones as planner.horizon=20"]
    return "\n".join(lines) + "\n" + OmegaConf.to_yaml(first_job(request).config)
