"""The parser of a command: messages, help and tab completion derive from its options."""

import argparse
import shutil
import textwrap
from collections.abc import Sequence
from typing import Any

from ..config.folders import home_expanded
from ..config.request import Request
from ..errors import ConfigError, unknown_key
from . import exit_codes

WIDTH = 100  # of help texts
PATHS = ("DIR", "FILE")  # what options that take paths call their value in help texts
OVERRIDE_SIGNS = ("+", "~")  # +KEY=VALUE adds a key, ~KEY removes one


class CommandParser(argparse.ArgumentParser):
    """Parses the words of one command. Options may stand anywhere; a mistake is a `ConfigError`."""

    def __init__(self, name: str, usage: str, description: str, epilog: str = "") -> None:
        super().__init__(
            prog=f"mppi-belief {name}",
            usage=usage,
            description=description,
            epilog="\n\n".join(filter(None, [epilog, exit_codes.help_text(name)])),
            formatter_class=_HelpFormatter,
            add_help=False,
            allow_abbrev=False,
            exit_on_error=False,
        )
        self.name = name
        self.add_argument("words", nargs="*", help=argparse.SUPPRESS)
        self.add_argument("--help", "-h", action="store_true", help="print this and stop")

    @property
    def options(self) -> list[str]:
        """Returns the spellings of all options."""
        return [spelling for action in self._actions for spelling in action.option_strings]

    def read(self, args: Sequence[str]) -> argparse.Namespace:
        """Returns the options and, as `words`, everything else. Raises `ConfigError`."""
        if "--" in args:
            raise ConfigError(self._unknown("--"))
        try:
            namespace, unknown = self.parse_known_intermixed_args(list(args))
        except argparse.ArgumentError as error:
            raise ConfigError(self._complaint(error)) from None
        for word in [*unknown, *namespace.words]:
            if word.startswith("-"):
                raise ConfigError(self._unknown(word.partition("=")[0]))
        for action in self._actions:
            if action.metavar in PATHS:
                self._expand_home(action, namespace)
        return namespace

    def _expand_home(self, action: argparse.Action, namespace: argparse.Namespace) -> None:
        """Puts the home folder for `~`, which a shell leaves as it is in `--to=~/x`."""
        try:
            paths = [home_expanded(path) for path in getattr(namespace, action.dest)]
        except ValueError as error:
            raise ConfigError(f"{action.option_strings[0]} {error}") from None
        setattr(namespace, action.dest, paths)

    def error(self, message: str) -> Any:
        """Raises `ConfigError` where argparse would end the process."""
        raise ConfigError(message)

    def _unknown(self, option: str) -> str:
        see = f"mppi-belief {self.name} --help"
        return unknown_key(option, self.options, what="option", see=see)

    def _complaint(self, error: argparse.ArgumentError) -> str:
        option = (error.argument_name or "").partition("/")[0]
        if error.message == "expected one argument":
            return f"{option}: needs a value"
        if error.message.startswith("ignored explicit argument"):
            return f"{option}: takes no value"
        return f"{option}: {error.message}"


def configuration_parser(
    name: str, usage: str, description: str, epilog: str = ""
) -> CommandParser:
    """Returns the parser of a command that composes configurations, with the options that all of
    those have.
    """
    parser = CommandParser(name, usage, description, epilog)
    add = parser.add_argument
    add(
        *("-m", "--multirun"),
        action="store_true",
        help="comma-separated values make a sweep: one plan, one pool, one table",
    )
    add(
        *("--config-dir", "-cd"),
        action="append",
        default=[],
        metavar="DIR",
        help="also look for yaml files, and for the Python modules they name, in DIR",
    )
    add(
        *("--cfg", "-c"),
        choices=["job"],
        help="print the composed configuration (of a sweep: the first one) and stop",
    )
    add("--resolve", action="store_true", help="with --cfg: replace ${...} by values")
    add(
        *("--info", "-i"),
        choices=["defaults"],
        help="print which file each group of the configuration comes from and stop",
    )
    return parser


def request_of(namespace: argparse.Namespace, args: Sequence[str], command: str) -> Request:
    """Returns the request of a command that composes configurations."""
    if namespace.resolve and namespace.cfg is None:
        raise ConfigError("--resolve goes with --cfg")
    return Request(
        overrides=tuple(namespace.words),
        config_dirs=tuple(namespace.config_dir),
        multirun=namespace.multirun,
        print_help=namespace.help,
        print_configuration=namespace.cfg is not None,
        resolve=namespace.resolve,
        print_sources=namespace.info is not None,
        command=("mppi-belief", command, *args),
    )


def request_before(parser: CommandParser, before: Sequence[str]) -> Request:
    """Returns the request of the words before the one that is completed; an empty one where they
    cannot be parsed.
    """
    try:
        namespace = parser.read(before)
    except ConfigError:
        return Request()
    return Request(
        overrides=tuple(word for word in namespace.words if is_override(word)),
        config_dirs=tuple(namespace.config_dir),
        multirun=namespace.multirun,
    )


def wrapped(names: Sequence[str]) -> str:
    """Returns names as indented lines of a help text."""
    text = ", ".join(names)
    return textwrap.fill(text, WIDTH - 10, initial_indent="  ", subsequent_indent="  ")


def is_override(word: str) -> bool:
    """Returns whether a word changes a setting, as opposed to a name."""
    return "=" in word or word.startswith(OVERRIDE_SIGNS)


class _HelpFormatter(argparse.RawDescriptionHelpFormatter):
    """Keeps the lines of descriptions and gives the options a column of their own."""

    def __init__(self, prog: str) -> None:
        columns = shutil.get_terminal_size().columns
        super().__init__(prog, max_help_position=24, width=max(60, min(columns, WIDTH)))

    def _format_action_invocation(self, action: argparse.Action) -> str:
        """Returns the spellings of an option and its value once, as Python 3.13 prints them.

        Earlier versions repeat the value after every spelling.
        """
        if not action.option_strings or action.nargs == 0:
            return super()._format_action_invocation(action)
        metavar = self._get_default_metavar_for_optional(action)
        return f"{', '.join(action.option_strings)} {self._format_args(action, metavar)}"
