"""Texts are taken as they are written, in yaml and on the command line, and numbers mean the same
in both.
"""

import math
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser
from hypothesis import example, given, settings
from hypothesis import strategies as st
from omegaconf import OmegaConf

from cli_helpers import SMALL, call, files_in, restored
from mppi_belief.cli import replay, report, results, run, verify
from mppi_belief.config import compose as composing
from mppi_belief.config.executors import SlurmExecutor, read_executor
from mppi_belief.config.hydra_words import word_for_hydra
from mppi_belief.config.settings import Settings
from mppi_belief.config.text_keys import LISTS_OF_TEXTS, OPTIONAL_TEXTS, TEXTS
from mppi_belief.config.yaml_files import read_yaml
from mppi_belief.errors import ConfigError

# Words that another reader takes for numbers, truth values, null, lists, calls or quotes.
WRITTEN = [
    *("1234e567", "9999e999", "12345e6", "2026_11_30", "1e3", "1_000", "007", "0x10", "0o17"),
    *("0b1", "1:30", "10:00:00", "2026-11-30", ".5", "1.", "+3", "-0", "inf", "nan", ".inf"),
    *("true", "Yes", "off", "null", "Null", "a,b", "a, b", "[a]", "[1", "{a: 1}", "out/lr=0.1"),
    *("out (1)", "out#2", "out #2", "f(x)", "choice(1,2)", "'quoted'", '"quoted"', "it's", "a\\b"),
    *("a\\", "\\'", " both ends ", "Ergebnisse_für_mich", "日本", "a: b", "- a", "&a", "*a", "!a"),
    *("@x", "%y", "`z`", "|", ">", "?", "???", "=", "<<", "a~b", "$HOME", "{}", "a${", "\\${seed}"),
]
PRINTABLE = st.text(min_size=1, max_size=20).filter(lambda text: text.isprintable())


def as_read_by_hydra(word: str) -> Any:
    (override,) = OverridesParser.create().parse_overrides([word_for_hydra(word, ["system"])])
    return override.value()


def as_read_from(folder: Path, text: str) -> Any:
    path = folder / "file.yaml"
    path.write_text(text, encoding="utf-8")
    return read_yaml(path)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("yaml")


@settings(max_examples=100, derandomize=True, deadline=None)
@given(text=PRINTABLE | st.sampled_from(WRITTEN))
def test_any_printable_text_reaches_hydra_as_written(text):
    assert as_read_by_hydra(f"results_dir={text}") == text
    assert as_read_by_hydra(f"++verify_dir={text}") == text


@settings(max_examples=60, derandomize=True, deadline=None)
@given(text=PRINTABLE | st.sampled_from(WRITTEN))
def test_any_printable_text_is_read_from_yaml_as_written(folder, text):
    for style in ("'", '"'):
        written = yaml.safe_dump({"results_dir": text}, default_style=style, allow_unicode=True)
        assert as_read_from(folder, written) == {"results_dir": text}


@pytest.mark.parametrize("text", [text for text in WRITTEN if re.fullmatch(r"[\w.,:+-]+", text)])
def test_a_text_needs_no_quotes_in_yaml(folder, text):
    lines = f"results_dir: {text}\nexecutor:\n  partition: {text}\n  directives: [{text}, x]\n"
    expected = None if text.lower() == "null" else text
    assert as_read_from(folder, lines) == {
        "results_dir": text,
        "executor": {"partition": expected, "directives": [*text.split(","), "x"]},
    }


@pytest.mark.parametrize("key", ["planner.horizon", "controller.horizon"])
def test_a_message_names_the_key_that_was_written(key, tmp_path, capsys):
    ended = call(tmp_path, capsys, "run", *SMALL, f"{key}=0")
    assert (ended.code, ended.err) == (2, f"mppi-belief: {key} must be at least 1, got 0\n")


@pytest.mark.parametrize("text", ["1234e567", "2026_11_30", "0x10"])
def test_an_alias_leaves_the_other_key_a_number(folder, text):
    content = as_read_from(folder, f"seed: &a {text}\nresults_dir: *a\n")
    assert content["results_dir"] == text
    assert content["seed"] == as_read_by_hydra(f"seed={text}")


SCALARS = (str, int, float, bool, type(None))
NUMBER_LIKE = r"[+-]?[0-9]{0,3}(_[0-9])?\.?[0-9]{0,2}([eE][+-]?[0-9]{1,3})?"
WORD = st.text("0123456789_.+-eExXobinfatrulsy:", min_size=1, max_size=8)


@settings(max_examples=150, derandomize=True, deadline=None)
@given(word=WORD | st.from_regex(NUMBER_LIKE, fullmatch=True))
@example(word="017")
@example(word="1e3")
@example(word="10:00:00")
@example(word=".5e3")
@example(word="1_000.5_0")
@example(word="yes")
@example(word="TRUE")
@example(word="-inf")
@example(word="NaN")
def test_a_plain_word_means_the_same_in_both(folder, word):
    try:
        value = as_read_from(folder, f"problem:\n  dt: {word}\n")["problem"]["dt"]
    except (yaml.YAMLError, AttributeError):
        return  # `- a` and `: a` are no scalars
    if word and not word.endswith(":") and isinstance(value, SCALARS):
        expected = as_read_by_hydra(f"problem.dt={word}")
        assert repr(value) == repr(expected), word


def configuration(*words: str) -> dict[str, Any]:
    """The configuration of a command, which no other test changes."""
    with restored():
        (config,) = composing.collect(run.parse([*SMALL, *words]))
    return config


def test_texts_arrive_in_the_settings():
    texts = {"results_dir": "1234e567", "report_dir": "out (1)#2, a=b", "verify_dir": "für mich "}
    config = configuration(*(f"{key}={text}" for key, text in texts.items()), "shard=1/2")
    assert {key: config[key] for key in texts} == texts
    assert config["shard"] == "1/2"
    assert configuration("shard=null", "results_dir=null")["results_dir"] == "null"
    assert configuration("results_dir=out/${seed}", "report_dir=\\${x}")["results_dir"] == "out/0"
    assert configuration("report_dir=\\${x}")["report_dir"] == "${x}"


def test_texts_of_an_executor_arrive():
    words = ("executor.partition=a,b", "executor.account=1234e5", "executor.logs=out (1)")
    config = configuration("executor=slurm", *words, "executor.directives=['1e3',--x]")
    assert read_executor(config["executor"]) == SlurmExecutor(
        partition="a,b", account="1234e5", logs="out (1)", directives=["1e3", "--x"]
    )
    with pytest.raises(ConfigError, match=r"^executor\.directives: 1000\.0 must be a text; "):
        configuration("executor=slurm", "executor.directives=[1e3]")


def test_all_texts_are_known():
    assert {"results_dir", "shard", "executor.partition", "executor.logs"} <= TEXTS
    assert {key for key in TEXTS if key.startswith("executor.")} > {"executor.address"}
    assert OPTIONAL_TEXTS < TEXTS
    assert {"executor.directives"} == LISTS_OF_TEXTS
    assert {key for key in TEXTS if "." not in key} < set(Settings.__dataclass_fields__)


@pytest.fixture
def mine(tmp_path) -> Path:
    """A folder of --config-dir, with studies whose names and settings look like numbers."""
    studies = tmp_path / "mine" / "experiment"
    studies.mkdir(parents=True)
    header = "# @package _global_\n"
    (studies / "hash.yaml").write_text(f"{header}results_dir: 1234e567\n")
    (studies / "tilde.yaml").write_text(f"{header}results_dir: ~/tilde_test\n")
    (studies / "2026_11_30.yaml").write_text(f"{header}results_dir: date\n")
    (studies / "für.yaml").write_text(f"{header}defaults:\n  - override /experiment: 1e3\n")
    (studies / "1e3.yaml").write_text(f"{header}results_dir: a number\n")
    swept = "hydra:\n  mode: MULTIRUN\n  sweeper:\n    params:\n      seed: 1_0,0\n"
    (studies / "swept.yaml").write_text(f"{header}{swept}results_dir: 1_0\n")
    return tmp_path / "mine"


@pytest.mark.parametrize(
    ("name", "results_dir"),
    [("hash", "1234e567"), ("2026_11_30", "date"), ("1e3", "a number")],
)
def test_texts_and_names_of_a_users_yaml(mine, name, results_dir):
    config = configuration("--config-dir", str(mine), f"experiment={name}")
    assert config["results_dir"] == results_dir
    requests = report.parse([f"experiment={name}", "--config-dir", str(mine)])
    assert requests[0] == [name]


def test_values_that_a_yaml_sweeps_are_in_the_notation_of_the_command_line(mine):
    configs = composing.collect(run.parse([*SMALL, "--config-dir", str(mine), "experiment=swept"]))
    assert [config["seed"] for config in configs] == [10, 0]
    assert configs[0]["results_dir"] == "1_0"


def test_names_are_swept_with_commas():
    words = ["system=scalar_linear,point_robot", "precision=float32, float64"]
    configs = composing.collect(run.parse(["-m", *words]))
    assert len(configs) == 4
    assert {config["precision"] for config in configs} == {"float32", "float64"}
    several = "system=scalar_linear,point_robot"
    with pytest.raises(ConfigError, match=f"^{several}: several values; add -m"):
        composing.collect(run.parse([several]))


@pytest.mark.parametrize("text", [*WRITTEN, "out/${seed}"])
def test_all_commands_read_a_folder_alike(text):
    if text == "a${":
        with pytest.raises(ConfigError, match=r"results_dir: \$\{ begins a reference"):
            results.parse([f"results_dir={text}"])
        return
    composed = OmegaConf.create({"results_dir": as_read_by_hydra(f"results_dir={text}"), "seed": 0})
    folder = OmegaConf.to_container(composed, resolve=True)["results_dir"]
    assert results.parse([f"results_dir={text}"]).root == Path(folder)
    assert replay.parse(["cell", "0", f"results_dir={text}"]).root == Path(folder)


HOME_WORDS = ["results_dir=~/out", "report_dir=~", "verify_dir=~/a/~"]


def test_a_tilde_is_the_home_folder_wherever_a_path_is_given(mine, monkeypatch):
    home = mine.parent
    monkeypatch.setenv("HOME", str(home))
    config = configuration(*HOME_WORDS, "executor=slurm", "executor.logs=~/logs")
    folders = [config[word.partition("=")[0]] for word in HOME_WORDS]
    assert folders == [f"{home}/out", f"{home}", f"{home}/a/~"]
    assert config["executor"]["logs"] == f"{home}/logs"
    config = configuration("--config-dir=~/mine", "experiment=tilde")
    assert config["results_dir"] == f"{home}/tilde_test"
    assert results.parse(["results_dir=~/out"]).root == home / "out"
    assert replay.parse(["c", "0", "--config-dir=~/mine"]).options.config_dir == [str(mine)]
    assert results.parse(["export", "--to=~/all.csv"]).options.to == [f"{home}/all.csv"]
    assert verify.parse(["--config-dir=~/mine"]).config_dirs == (str(mine),)
    assert configuration("results_dir=./~/x")["results_dir"] == "./~/x"


def test_a_home_that_is_not_known_is_refused_and_no_folder_is_made(tmp_path, capsys):
    for words in (
        ["run", *SMALL, "results_dir=~no-such-user/x"],
        ["results", "results_dir=~no-such-user/x"],
        ["results", "export", "--to=~no-such-user/x"],
        ["run", "--config-dir=~no-such-user/x"],
        ["results", "show", "~no-such-user/x"],
    ):
        ended = call(tmp_path, capsys, *words)
        assert (ended.code, ended.err.count("\n")) == (2, 1)
        assert "is ~no-such-user/x, but the home folder ~no-such-user is not known" in ended.err
    assert files_in(tmp_path) == []


@pytest.mark.parametrize(
    "value", ["out (1)", "out#2", "für", "[1", "it's (1)", 'a"b(', "a\\b(", "${", "{", "f(", "a=b("]
)
def test_a_word_that_cannot_be_read_names_the_way_that_works(value):
    word = f"system.label={value}"
    with pytest.raises(ConfigError) as caught:
        configuration(word)
    line = str(caught.value)
    assert line.startswith(f"{word}: is no number, list, mapping or plain word; ")
    (printed,) = shlex.split(line.rpartition(" a text is given as ")[2])
    assert as_read_by_hydra(printed) == value


def test_whole_numbers_and_floats_of_settings_are_those_of_both(mine):
    (mine / "experiment" / "numbers.yaml").write_text(
        "# @package _global_\nseed: 017\ntheta: 1_0.5\nw_obs: 1e3\nproblem: {dt: .5}\n"
    )
    words = ("seed=017", "theta=1_0.5", "w_obs=1e3", "problem.dt=.5")
    from_words = configuration(*words)
    from_yaml = configuration("--config-dir", str(mine), "experiment=numbers")
    for config in (from_words, from_yaml):
        assert [config["seed"], config["theta"], config["w_obs"]] == [17, 10.5, 1000.0]
        assert math.isclose(config["problem"]["dt"], 0.5)


def test_only_the_yaml_files_that_are_composed_are_read(mine):
    (mine / "system").mkdir()
    (mine / "system" / "broken.yaml").write_text("a: &a [*a]\n")
    assert configuration("--config-dir", str(mine), "experiment=hash")
    with pytest.raises(ConfigError, match=r"broken\.yaml:1: \*a contains itself"):
        composing.collect(run.parse(["--config-dir", str(mine), "system=broken"]))
