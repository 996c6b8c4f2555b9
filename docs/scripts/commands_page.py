"""Writes the help of every command into docs/commands.md, as its parser prints it.

python docs/scripts/commands_page.py
"""

import io
from contextlib import redirect_stdout
from pathlib import Path

from mppi_belief.cli.main import COMMANDS, overview

PAGE = Path(__file__).resolve().parents[1] / "commands.md"
START = "<!-- help -->"
END = "<!-- end -->"


def help_text() -> str:
    """Returns the help of `mppi-belief` and of every command as Markdown."""
    parts = [f"```text\n{overview().rstrip()}\n```"]
    for name in COMMANDS:
        parts.append(f"### mppi-belief {name}")
        parts.append(f"```text\n{printed_help(name)}\n```")
    return "\n\n".join(parts)


def printed_help(name: str) -> str:
    """Returns what a command prints for `--help`; of `run` without the settings."""
    command = COMMANDS[name]
    if name == "run":
        return str(command.parser().format_help()).rstrip()
    with redirect_stdout(io.StringIO()) as output:
        command.main(["--help"])
    return output.getvalue().rstrip()


def with_help(page: str) -> str:
    """Returns the page with the help of today between its markers."""
    head, _, rest = page.partition(START)
    _, _, tail = rest.partition(END)
    return f"{head}{START}\n\n{help_text()}\n\n{END}{tail}"


def main() -> None:
    """Writes the page."""
    PAGE.write_text(with_help(PAGE.read_text()))


if __name__ == "__main__":
    main()
