"""The calibrated numbers of conf/, for code that needs them without composing a configuration.

conf/ is the only home of these numbers. Certificates and tests read them here instead of copying
them:

    reference("cost", "goal_obstacles")["obstacle_penalty"]["margin"]   # 0.17
    reference("system", "light_dark")["problem"]         # a system's file also holds the problem
    reference_settings()["w_obs"]                        # the top level of conf/config.yaml
"""

from pathlib import Path
from typing import Any

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from ..errors import ConfigError
from ..fields import checked, rules
from .conf_files import conf_dir
from .hydra_errors import config_error_line
from .settings import Settings
from .yaml_files import read_yaml

OVERRIDE = "override /"  # before the group whose option a defaults list replaces
GLOBAL_PACKAGE = "# @package _global_"  # first line of a file whose keys are those of the top level


def reference(group: str, option: str) -> dict[str, Any]:
    """Returns the content of conf/GROUP/OPTION.yaml as plain Python values.

    References to other settings, such as `${w_obs}` or `${cost.control_weight}`, are replaced by
    the values that conf/config.yaml and its default options give them. Raises FileNotFoundError if
    there is no such file.
    """
    options = _default_options() | {group: option}
    options = _options_of("system", options["system"]) | options
    parts = _overrides_of("system", options["system"]) | _overrides_of(group, option)
    settings = OmegaConf.create(_top_level())
    for chosen_group, chosen_option in options.items():
        settings.merge_with(_content(chosen_group, chosen_option, parts))
    content = _content(group, option, parts)
    values = {key: _to_plain(settings[key]) for key in content}
    return values if _is_global(group, option) else values[group]


def reference_settings() -> dict[str, Any]:
    """Returns the settings at the top level of conf/config.yaml: `theta`, `w_obs`, `planner`."""
    return _to_plain(OmegaConf.create(_top_level()))


def reference_folder(key: str, text: str | None = None) -> Path:
    """Returns the folder that a setting of the top level names, by default that of conf/.

    `text` is the value as it is written on the command line; `${...}` refers to the other settings
    of conf/config.yaml. Raises `ConfigError`, as composing the setting would.
    """
    settings = OmegaConf.create(_top_level())
    if text is not None:
        try:
            settings[key] = text
        except Exception as error:
            raise ConfigError(config_error_line(error)) from error
    try:
        name: Any = checked(key, _to_plain(settings)[key], rules(Settings)[key])
    except ValueError as error:
        raise ConfigError(str(error)) from None
    except OmegaConfBaseException as error:
        raise ConfigError(config_error_line(error)) from error
    return Path(name)


def _top_level() -> dict[str, Any]:
    """Returns conf/config.yaml without what is meant for Hydra."""
    return _settings_in(_read(conf_dir() / "config.yaml"))


def _default_options() -> dict[str, str]:
    """Returns the option of each group that conf/config.yaml chooses."""
    return _options_in(_read(conf_dir() / "config.yaml"))


def _content(group: str, option: str, parts: dict[str, str]) -> dict[str, Any]:
    """Returns what a file sets, by keys of the top level; includes the file of its group that it
    builds on, if any.

    `parts` are options of nested groups that replace those of the file's own defaults list.
    """
    own = _load(group, option)
    content = OmegaConf.create()
    for entry in own.get("defaults", []):
        if isinstance(entry, str) and entry != "_self_":
            content.merge_with(_content(group, entry, parts))
    for name, part in _parts_in(own).items():
        nested = f"{group}/{name}"
        content.merge_with(_content(nested, parts.get(nested, part), parts))
    settings = _settings_in(own)
    content.merge_with(settings if _is_global(group, option) else _nested(group, settings))
    return _unresolved(content)


def _options_of(group: str, option: str) -> dict[str, str]:
    """Returns the options of groups that a file chooses, or the files of its group below it."""
    options: dict[str, str] = {}
    for own in _files_of(group, option):
        options |= _options_in(own)
    return options


def _overrides_of(group: str, option: str) -> dict[str, str]:
    """Returns the options of nested groups that a file, or one below it, chooses in place of
    others: `- override /cost/obstacle_penalty: bump`.
    """
    overrides: dict[str, str] = {}
    for own in _files_of(group, option):
        for entry in own.get("defaults", []):
            if isinstance(entry, dict):
                overrides |= {
                    name.removeprefix(OVERRIDE): part
                    for name, part in entry.items()
                    if name.startswith(OVERRIDE)
                }
    return overrides


def _files_of(group: str, option: str) -> list[dict[str, Any]]:
    """Returns the content of a file after those of the files of its group that it builds on."""
    own = _load(group, option)
    files: list[dict[str, Any]] = []
    for entry in own.get("defaults", []):
        if isinstance(entry, str) and entry != "_self_":
            files += _files_of(group, entry)
    return [*files, own]


def _options_in(content: dict[str, Any]) -> dict[str, str]:
    """Returns the options of groups that the defaults list of a file chooses: `- /cost:
    goal_obstacles`.
    """
    options: dict[str, str] = {}
    for entry in content.get("defaults", []):
        if isinstance(entry, dict):
            options |= {name.strip("/"): option for name, option in entry.items()}
    return {group: option for group, option in options.items() if (conf_dir() / group).is_dir()}


def _parts_in(content: dict[str, Any]) -> dict[str, str]:
    """Returns the options of nested groups that a defaults list chooses: `- sampler: nominal`."""
    parts: dict[str, str] = {}
    for entry in content.get("defaults", []):
        if isinstance(entry, dict):
            parts |= {name.partition("@")[0]: option for name, option in entry.items()}
    return {name: option for name, option in parts.items() if name.isidentifier()}


def _nested(group: str, settings: dict[str, Any]) -> dict[str, Any]:
    """Returns settings below the keys of their group: those of `controller/sampler` below both."""
    node = settings
    for name in reversed(group.split("/")):
        node = {name: node}
    return node


def _settings_in(content: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in content.items() if key not in ("defaults", "hydra")}


def _load(group: str, option: str) -> dict[str, Any]:
    return _read(_path(group, option))


def _read(path: Path) -> dict[str, Any]:
    return _unresolved(OmegaConf.create(read_yaml(path)))


def _unresolved(node: Any) -> dict[str, Any]:
    content: Any = OmegaConf.to_container(node, resolve=False)
    return dict(content)


def _to_plain(node: Any) -> Any:
    return OmegaConf.to_container(node, resolve=True) if OmegaConf.is_config(node) else node


def _is_global(group: str, option: str) -> bool:
    return _path(group, option).read_text().startswith(GLOBAL_PACKAGE)


def _path(group: str, option: str) -> Path:
    return conf_dir() / group / f"{option}.yaml"
