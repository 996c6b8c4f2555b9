"""`mppi-belief verify`: which certificates are computed, what is left of them, how it ends."""

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import pytest

from cli_helpers import TIMEOUT, Said, call, files_in, started
from mppi_belief.cli import certify_on_pool
from mppi_belief.results.certificate import CERTIFICATE_NAMES, Certificate
from mppi_belief.results.certificate_files import (
    StoredCertificate,
    load_certificates,
    store_certificate,
)
from mppi_belief.verify import compute
from mppi_belief.verify.bands import at_most
from study_helpers import poll, workers_of

CHEAP = "matching_feasibility"


@pytest.fixture
def verify(tmp_path, capsys) -> Callable[..., Said]:
    """The command, in this process and a folder of its own."""
    return lambda *args: call(tmp_path, capsys, "verify", *args)


def certificate(name: str, value: float = 0.0) -> Certificate:
    return Certificate(name, f"Statement of {name}", "", [at_most("x", value, 1.0, "")])


@pytest.fixture
def instant(monkeypatch) -> list[tuple]:
    """Certificates that cost nothing, the last of which fails for seed 13; the calls that were
    made.
    """
    calls = []

    def certify_all(names, seed, workers) -> Iterator[compute.CertificateOutcome]:
        calls.append((tuple(names), seed, workers))
        for name in reversed(names):
            yield compute.CertificateOutcome(
                name, certificate(name, 2.0 if seed == 13 and name == names[-1] else 0.0), "", 0.5
            )

    monkeypatch.setattr(certify_on_pool, "certify_all", certify_all)
    return calls


def test_help_names_every_certificate(verify):
    ended = verify("--help")
    assert ended.code == 0
    assert all(name in ended.out for name in CERTIFICATE_NAMES)


def test_all_of_them_by_default(verify, instant, tmp_path):
    ended = verify("seed=5", "workers=3")
    assert (ended.code, instant) == (0, [(CERTIFICATE_NAMES, 5, 3)])
    assert f"{len(CERTIFICATE_NAMES)} of {len(CERTIFICATE_NAMES)} certificates hold" in ended.out
    assert [line for line in ended.out.splitlines() if line.startswith("Statement of")] == [
        f"Statement of {name}  (0.5 s)" for name in CERTIFICATE_NAMES
    ]
    assert {f"{name}.json" for name in CERTIFICATE_NAMES} <= set(
        files_in(tmp_path / "outputs" / "verify")
    )


def test_one_that_does_not_hold_is_exit_1(verify, instant):
    ended = verify("seed=13")
    assert ended.code == 1
    assert ended.out.count("FAILS") == 1


def test_some_of_them_leave_the_others_alone(verify, instant, tmp_path):
    verify("verify_dir=here")
    before = (tmp_path / "here" / "cole_hopf.json").read_bytes()
    ended = verify("feynman_kac", "affine_observations", "seed=13", "verify_dir=here")
    assert ended.code == 1
    assert instant[-1][0] == ("feynman_kac", "affine_observations")
    assert (tmp_path / "here" / "cole_hopf.json").read_bytes() == before
    assert {
        stored.certificate.name: stored.source["seed"]
        for stored in load_certificates(tmp_path / "here")
    } == {name: 13 if name in instant[-1][0] else 0 for name in CERTIFICATE_NAMES}


@pytest.mark.parametrize(
    ("args", "complaint"),
    [
        (["cole_hop"], "unknown certificate 'cole_hop'; did you mean 'cole_hopf'?"),
        ([""], "unknown certificate ''; see mppi-belief verify --help"),
        (["zzz"], "unknown certificate 'zzz'; see mppi-belief verify --help"),
        (
            ["cole_hopf", "system=light_dark"],
            "verify: either certificates or a system, not 'cole_hopf' with",
        ),
        (["sede=3"], "unknown key 'sede'; did you mean 'seed'?"),
        (["seed=-1"], "seed must be at least 0, got -1"),
        (["-m", "theta=0,1"], "verify: one system at a time"),
        (["verify_dir="], "verify_dir must name a folder"),
        (
            ["cole_hopf", "seed=1", "theta=0"],
            "verify: either certificates or a system, not 'cole_hopf' with 'theta=0'",
        ),
        (["--config-dir", "."], "verify: --config-dir is for a system; name it with system=NAME"),
    ],
)
def test_a_mistake_is_one_line(verify, instant, args, complaint):
    ended = verify(*args)
    assert ended.code == 2
    assert ended.err.startswith(f"mppi-belief: {complaint}")
    assert ended.err.count("\n") == 1
    assert not instant


def test_what_cannot_be_written_is_exit_74(verify, instant, tmp_path):
    (tmp_path / "taken").write_text("")
    assert verify("verify_dir=taken").code == 74


def test_a_keyboard_interrupt_is_exit_130(verify, monkeypatch):
    def stopped(*args) -> Iterator[compute.CertificateOutcome]:
        raise KeyboardInterrupt

    monkeypatch.setattr(certify_on_pool, "certify_all", stopped)
    ended = verify()
    assert (ended.code, ended.err.splitlines()[-1]) == (130, "mppi-belief: stopped")


def test_a_real_one_in_a_process_of_its_own(verify, tmp_path):
    ended = verify(CHEAP)
    assert ended.code == 0, ended.out + ended.err
    assert ended.out.startswith("Proposition 3")
    stored = json.loads((tmp_path / "outputs" / "verify" / f"{CHEAP}.json").read_text())
    assert stored["source"]["command"] == ["mppi-belief", "verify", CHEAP]
    assert stored["source"]["versions"]["jax"]


def test_what_a_certificate_raises_is_said():
    (outcome,) = certify_on_pool.certify_all(["not_there"], 0, 1)
    assert outcome.certificate is None
    assert outcome.error.startswith("ModuleNotFoundError: No module named")


def die(config: dict, trials: Sequence[int]) -> None:
    """Ends its process."""
    os._exit(3)


def test_a_process_that_always_dies_is_given_up():
    (outcome,) = certify_on_pool.certify_all([CHEAP], 0, 1, die)
    assert (outcome.name, outcome.certificate) == (CHEAP, None)
    assert "died 2 times" in outcome.error


def die_once(marker: str, config: dict, trials: Sequence[int]) -> compute.CertificateOutcome:
    """Ends the first process that computes a certificate."""
    if not Path(marker).exists():
        Path(marker).write_text("")
        os._exit(3)
    return compute.compute_certificate(config, trials)


def test_a_process_that_dies_once_takes_nothing_with_it(tmp_path):
    work = partial(die_once, str(tmp_path / "died"))
    outcomes = list(certify_on_pool.certify_all([CHEAP, "cole_hopf"], 0, 2, work))
    assert {outcome.name for outcome in outcomes} == {CHEAP, "cole_hopf"}
    assert all(
        outcome.certificate is not None and outcome.certificate.holds for outcome in outcomes
    )


def test_what_could_not_be_computed_leaves_what_was_stored(verify, instant, tmp_path, monkeypatch):
    verify("verify_dir=here")
    before = (tmp_path / "here" / "cole_hopf.json").read_bytes()

    def certify_all(names, *rest) -> Iterator[compute.CertificateOutcome]:
        yield compute.CertificateOutcome("cole_hopf", None, "ValueError: no", 0.1)
        yield compute.CertificateOutcome("feynman_kac", certificate("feynman_kac"), "", 0.1)

    monkeypatch.setattr(certify_on_pool, "certify_all", certify_all)
    ended = verify("cole_hopf", "feynman_kac", "verify_dir=here")
    assert ended.code == 1
    assert "cole_hopf could not be computed: ValueError: no" in ended.err
    assert "1 of 1 certificates hold" in ended.out
    assert (tmp_path / "here" / "cole_hopf.json").read_bytes() == before


def test_a_name_given_twice_is_computed_once(verify, instant):
    verify("cole_hopf", "cole_hopf")
    assert instant[-1][0] == ("cole_hopf",)


def test_a_question_to_hydra_is_answered(verify, instant):
    ended = verify("--cfg", "job")
    assert (ended.code, instant) == (0, [])
    assert "controller" in ended.out


def is_gone(group: int) -> bool:
    """Whether all processes of a group end within ten seconds."""
    for _ in range(100):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.1)
    return False


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_it_with_one_word(tmp_path, number, code):
    with started(tmp_path, "verify") as process:
        poll(lambda: workers_of(process.pid), TIMEOUT)  # they compute for a minute
        process.send_signal(number)
        assert process.wait(30) == code
        assert is_gone(process.pid)
    assert (tmp_path / "stderr.txt").read_text().splitlines()[-1] == "mppi-belief: stopped"


def report(tmp_path: Path, capsys: pytest.CaptureFixture[str], *args: str) -> Said:
    return call(tmp_path, capsys, "report", *args)


def test_the_report_shows_certificates_and_says_which_are_missing(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("mppi_belief.report.build.STUDIES", ("table_1",))
    folder = tmp_path / "outputs" / "verify"
    for name in CERTIFICATE_NAMES[:4]:
        store_certificate(
            folder, StoredCertificate(certificate(name), 0.1, {"commit": "4a7f400", "seed": 0})
        )
    ended = report(tmp_path, capsys)
    assert ended.code == 3
    assert (
        f"missing: {len(CERTIFICATE_NAMES) - 4} of {len(CERTIFICATE_NAMES)} certificates; "
        "mppi-belief verify" in ended.out
    )
    page = (tmp_path / "outputs" / "report" / "index.html").read_text()
    assert "Statement of affine_observations" in page
    assert (tmp_path / "outputs" / "report" / "theory.csv").is_file()


def test_a_report_of_chosen_studies_is_of_those_alone(tmp_path, capsys):
    store_certificate(
        tmp_path / "outputs" / "verify", StoredCertificate(certificate("cole_hopf"), 0.1, {})
    )
    ended = report(tmp_path, capsys, "experiment=table_1")
    assert "certificates" not in ended.out
    assert "cole_hopf" not in (tmp_path / "outputs" / "report" / "index.html").read_text()


def test_a_reader_that_goes_away_is_no_failure_to_write(tmp_path):
    with started(tmp_path, "verify", CHEAP, stdout=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.wait(100) == 141
    assert "cannot write" not in (tmp_path / "stderr.txt").read_text()
    assert (tmp_path / "outputs" / "verify" / f"{CHEAP}.json").is_file()
