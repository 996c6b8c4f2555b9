"""Lets Hydra read folders of yaml files through `yaml_files.read_yaml`.

Hydra offers two kinds of plugins for this: a source of configurations for a scheme of addresses,
here `mppi-belief://FOLDER`, and a plugin that may change the search path. With the second, conf/ is
read in the same way as the folders of `--config-dir`.
"""

from pathlib import Path

from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.object_type import ObjectType
from hydra.core.plugins import Plugins
from hydra.plugins.config_source import ConfigLoadError, ConfigResult, ConfigSource
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import OmegaConf

from .conf_files import conf_dir
from .yaml_files import read_yaml

SCHEME = "mppi-belief"
HEADER = 512  # characters at the beginning of a file in which Hydra looks for `# @package`


def address(folder: Path) -> str:
    """Returns the address of a folder in Hydra's search path."""
    return f"{SCHEME}://{folder}"


def register() -> None:
    """Makes both plugins known to Hydra; they stay known in this process."""
    plugins = Plugins.instance()
    plugins.register(YamlFolder)
    plugins.register(ReadConfThroughYamlFolder)


class YamlFolder(ConfigSource):
    """Represents a folder of yaml files, whose subfolders are groups."""

    @staticmethod
    def scheme() -> str:
        """Returns the scheme of its addresses."""
        return SCHEME

    def load_config(self, config_path: str) -> ConfigResult:
        """Returns the content of GROUP/OPTION with what its header says."""
        path = self._file(config_path)
        if not path.is_file():
            raise ConfigLoadError(f"Config not found : {path}")
        with path.open(encoding="utf-8") as stream:
            header = self._get_header_dict(stream.read(HEADER))
        package = header["package"]
        if package is None:
            package = config_path.rpartition("/")[0].replace("/", ".")
        content = read_yaml(path, "" if package == "_global_" else package)
        return ConfigResult(self.provider, self.full_path(), OmegaConf.create(content), header)

    def available(self) -> bool:
        """Returns whether the folder exists."""
        return self.is_group("")

    def is_group(self, config_path: str) -> bool:
        """Returns whether GROUP is a subfolder."""
        return (Path(self.path) / config_path).is_dir()

    def is_config(self, config_path: str) -> bool:
        """Returns whether GROUP/OPTION is a file."""
        return self._file(config_path).is_file()

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """Returns the groups and options in GROUP, sorted."""
        names: list[str] = []
        for path in (Path(self.path) / config_path).iterdir():
            inner = f"{config_path}/{path.name}" if config_path else path.name
            self._list_add_result(names, inner, path.name, results_filter)
        return sorted(set(names))

    def _file(self, config_path: str) -> Path:
        return Path(self.path) / self._normalize_file_name(config_path)


class ReadConfThroughYamlFolder(SearchPathPlugin):
    """Replaces the address of conf/ in a search path by the one that `YamlFolder` reads."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Changes the search path of an initialisation; those of other programs stay."""
        for element in search_path.get_path():
            if element.path == str(conf_dir()):
                element.path = address(conf_dir())
