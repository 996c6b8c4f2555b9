"""What a command line asks for.

`mppi_belief.cli` parses the words of a command once into a `Request`; everything after that reads
the request and never the words.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Request:
    """Holds the overrides and options of a command that composes configurations."""

    overrides: tuple[str, ...] = ()  # words KEY=VALUE, +KEY=VALUE and ~KEY, in their order
    config_dirs: tuple[str, ...] = ()  # folders of --config-dir: yaml files and Python modules
    multirun: bool = False  # -m: comma-separated values make a sweep
    print_help: bool = False  # --help
    print_configuration: bool = False  # --cfg job: print the configuration and stop
    resolve: bool = False  # --resolve: print it with ${...} replaced by values
    print_sources: bool = False  # --info defaults: print where its parts come from and stop
    retry_failed: bool = False  # run --retry-failed: run trials without a result again
    certificates: tuple[str, ...] = ()  # names given to `verify`
    command: tuple[str, ...] = ()  # the whole command line as typed, kept with the results

    @property
    def words(self) -> list[str]:
        """Returns the words that ask `run` for the same configurations."""
        words = list(self.overrides)
        for folder in self.config_dirs:
            words += ["--config-dir", folder]
        return words + ["-m"] * self.multirun


def key_of(override: str) -> str:
    """Returns the key that an override sets, without its signs: `theta` of `++theta=1`."""
    return override.lstrip("+~").partition("=")[0]
