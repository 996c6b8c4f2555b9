"""`mppi-belief verify`: computes certificates of the paper, or says what holds for a system."""

import contextlib
import dataclasses
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..config.request import Request, key_of
from ..errors import ConfigError, unknown_key
from . import exit_codes
from .parser import (
    CommandParser,
    configuration_parser,
    is_override,
    request_before,
    request_of,
    wrapped,
)

FIRST_FORM = """\
The first form computes certificates of the paper's statements, each a few numbers with the bands
they must lie in, and writes them with their figures into verify_dir. Without a name, it computes
all of:"""
SECOND_FORM = """\
The second form says which statements hold for the system that KEY=VALUE describe (as for run),
along the belief of its trial 0:

  mppi-belief verify system=light_dark
  mppi-belief verify --config-dir mine system=mine"""
SUMMARY = "certificates of the paper's theorems"
EXAMPLE = "mppi-belief verify system=light_dark"
COMMON_KEYS = ("seed", "precision", "platform", "batch")  # settings that describe no system


def parser(names: Sequence[str] = ()) -> CommandParser:
    """Returns the parser of this command; its help lists the certificates that there are."""
    return configuration_parser(
        "verify",
        usage=(
            "mppi-belief verify [CERTIFICATE ...] [seed=N] [workers=N] [verify_dir=DIR]\n"
            "       mppi-belief verify KEY=VALUE ... [--config-dir DIR]"
        ),
        description=f"{FIRST_FORM}\n{wrapped(names)}\n\n{SECOND_FORM}",
    )


def parse(args: Sequence[str]) -> Request:
    """Returns what the words of a `verify` command ask for. Raises `ConfigError` for an unknown
    certificate.
    """
    from ..results.certificate import CERTIFICATE_NAMES

    request = request_of(parser().read(args), args, "verify")
    names = [word for word in request.overrides if not is_override(word)]
    for name in names:
        if name not in CERTIFICATE_NAMES:
            see = "mppi-belief verify --help"
            raise ConfigError(unknown_key(name, CERTIFICATE_NAMES, what="certificate", see=see))
    return dataclasses.replace(
        request,
        overrides=tuple(word for word in request.overrides if is_override(word)),
        certificates=tuple(dict.fromkeys(names)),
    )


def main(args: Sequence[str]) -> int:
    """Computes the certificates, or answers the question about a system; returns the exit code."""
    from ..config import environment
    from ..config.compose import collect
    from ..config.written_keys import written_keys
    from ..results.certificate import CERTIFICATE_NAMES
    from .show_configuration import show, wants_printing

    request = parse(args)
    if request.print_help:
        print(parser(CERTIFICATE_NAMES).format_help(), end="")
        return exit_codes.DONE
    if wants_printing(request):
        return show(request)
    configs = collect(request)
    if len(configs) > 1:
        raise ConfigError("verify: one system at a time")
    config = configs[0]
    settings = _system_settings(request, config)
    environment.prepare()
    if settings:
        with written_keys(request):
            return verify_system(request, config, settings)
    return verify_paper(request, config, request.certificates or CERTIFICATE_NAMES)


def _system_settings(request: Request, config: dict[str, Any]) -> list[str]:
    """Returns the overrides that describe a system. Raises `ConfigError` where they do not go with
    the rest.
    """
    from ..config.settings import RUNTIME_KEYS

    if config["platform"] != "cpu":
        raise ConfigError(f"platform={config['platform']}: verify computes on the CPU")
    settings = [
        word for word in request.overrides if key_of(word) not in (*COMMON_KEYS, *RUNTIME_KEYS)
    ]
    if settings and request.certificates:
        name = request.certificates[0]
        raise ConfigError(
            f"verify: either certificates or a system, not '{name}' with '{settings[0]}'"
        )
    if request.config_dirs and not settings:
        raise ConfigError("verify: --config-dir is for a system; name it with system=NAME")
    return settings


def verify_paper(request: Request, config: dict[str, Any], names: Sequence[str]) -> int:
    """Computes, stores and shows certificates; returns the exit code."""
    from tqdm import tqdm

    from ..report.certificate_tables import show_certificates
    from ..results.certificate_files import StoredCertificate, load_certificates, store_certificate
    from ..results.files import probe
    from ..results.provenance import provenance
    from .certify_on_pool import certify_all

    folder = Path(config["verify_dir"])
    probe(folder)
    source = provenance(list(request.command)) | {"seed": config["seed"]}

    # Store each certificate as soon as it is computed.
    missing = []
    outcomes = certify_all(names, config["seed"], config["workers"])
    with contextlib.closing(outcomes):
        for outcome in tqdm(outcomes, total=len(names), unit="certificate", disable=None):
            if outcome.certificate is None:
                missing.append(outcome.name)
                message = f"{outcome.name} could not be computed: {outcome.error}"
                tqdm.write(message, file=sys.stderr)
            else:
                stored = StoredCertificate(outcome.certificate, outcome.seconds, source)
                store_certificate(folder, stored)

    # Show those of this run; the summary is of all that are stored.
    computed = load_certificates(folder, [name for name in names if name not in missing])
    all_hold = show_certificates(computed, load_certificates(folder), folder)
    return exit_codes.DONE if all_hold and not missing else exit_codes.CERTIFICATE_FAILS


def verify_system(request: Request, config: dict[str, Any], settings: Sequence[str]) -> int:
    """Stores and shows which statements hold for the system of a configuration; returns the exit
    code.
    """
    from ..config.targets import allow
    from ..report.certificate_tables import show_system_certificate
    from ..results.certificate_files import StoredCertificate, store_certificate
    from ..results.files import probe
    from ..results.provenance import provenance
    from ..run.slow_starts import announced
    from ..trial import build, check
    from ..verify.own_system import what_holds

    folder = Path(config["verify_dir"]) / "systems"
    probe(folder)
    allow(request.config_dirs)
    check(config)

    # The certificate's title: the system, the controller, and what else was set.
    options = {group: config["names"][group] for group in ("system", "controller")}
    others = [word for word in settings if key_of(word) not in options]
    title = ", ".join([*(f"{group}={name}" for group, name in options.items()), *others])

    began = time.perf_counter()
    temperature = config["planner"]["temperature"]
    name = "-".join(options.values())
    with announced(f"{name}: compiling and computing its conditions"):
        certificate = what_holds(*build(config), temperature, config["seed"], name, title)
    seconds = time.perf_counter() - began
    source = provenance(list(request.command)) | {"seed": config["seed"]}
    store_certificate(folder, StoredCertificate(certificate, seconds, source))
    show_system_certificate(certificate, folder)
    return exit_codes.DONE


def complete(before: Sequence[str], last: str) -> list[str]:
    """Returns what the last word of a `verify` command may become: a certificate or a setting."""
    from ..results.certificate import CERTIFICATE_NAMES
    from .completion import complete_setting

    names = [name for name in CERTIFICATE_NAMES if name.startswith(last) and name not in before]
    return names + complete_setting(request_before(parser(), before), last)
