"""What Hydra and OmegaConf raise, said plainly: which key, what is wrong, what is near."""

import re

import pytest
from omegaconf import OmegaConf

from cli_helpers import collect, compose
from mppi_belief.config.hydra_errors import config_error_line
from mppi_belief.errors import ConfigError

OPTIONS = r"no such option, choose from .*"


@pytest.mark.parametrize(
    ("args", "line"),
    [
        (["theta=abc"], r"theta must be a number, got abc"),
        (["n_trials=1.5"], r"n_trials must be a whole number, got 1\.5"),
        (["planner.horizon=many"], r"planner\.horizon must be a whole number, got many"),
        (["controler=belief"], r"unknown key 'controler'; did you mean 'controller'\?"),
        (
            ["controller=beleif"],
            rf"controller=beleif: {OPTIONS}belief, .*; did you mean 'belief'\?",
        ),
        (["system=moon"], rf"system=moon: {OPTIONS}beacons, light_dark, .*scalar_linear, .*"),
        (["sweep=thetta"], rf"sweep=thetta: {OPTIONS}; did you mean 'theta'\?"),
        (["thetta=1"], r"unknown key 'thetta'; did you mean 'theta'\?"),
        (["foo=1"], r"unknown key 'foo'; see mppi-belief run --help"),
        (["+foo=1"], r"unknown key 'foo'; see mppi-belief run --help"),
        (["++foo=1"], r"unknown key 'foo'; see mppi-belief run --help"),
        (["+foo.bar=1"], r"unknown key 'foo'; see mppi-belief run --help"),
        (
            ["controller.horizn=3"],
            r"unknown key 'controller\.horizn'; did you mean 'controller\.horizon'\?",
        ),
        (["system.lihgt=3"], r"unknown key 'system\.lihgt'; did you mean 'system\.light'\?"),
        (["problem.step=3"], r"unknown key 'problem\.step'; did you mean 'problem\.steps'\?"),
        (["planner.foo=1"], r"unknown key 'planner\.foo'; .*"),
        (["planner.horizn=1"], r"unknown key 'planner\.horizn'; did you mean 'planner\.horizon'\?"),
        (
            ["controller=ilqg", "controller.n_samples=1"],
            r"'controller\.n_samples' is a key of another controller than the one chosen.*",
        ),
        (["+planner.foo=1"], r"unknown key 'planner\.foo'; .*"),
        (
            ["controller.proposal=laplace"],
            r"unknown key 'controller\.proposal'; use controller/sampler=.* instead",
        ),
        (
            ["controller=ilqg", "controller/sampler=laplace"],
            r"the chosen controller has no 'controller/sampler'; see mppi-belief run --cfg job",
        ),
        (["theta"], r"theta: must have the form KEY=VALUE"),
        (["theta=1,2"], r"theta=1,2: several values; add -m to sweep over them"),
        (["-m", "theta=1,abc"], r"theta must be a number, got abc"),
        (["theta="], r"theta must be a number, got ''"),
        (["n_trials="], r"n_trials must be a whole number, got ''"),
        (["theta={a: 1}"], r"theta must be a number, got \{'a': 1\}"),
        (["theta=null"], r"theta must have a value, got null"),
        (["theta=[1"], r"theta=\[1: is no number, .* a text is given as 'theta=\"\[1\"'"),
        (["theta=int(x)"], r"theta=int\(x\): ValueError while evaluating 'int\(x\)': .*"),
        (["a b=1"], r"unknown key 'a b'; see mppi-belief run --help"),
        (["theta=${foo.bar}"], r"theta: \$\{foo\.bar\} refers to a key that does not exist"),
        (["theta=${theta}"], r"theta: refers to itself"),
        (["theta=${no:1}"], r"theta: \$\{no:\.\.\.\} calls a function that does not exist"),
        (["theta=${oc.env:NO_SUCH}"], r"theta: environment variable 'NO_SUCH' not found"),
        (["results_dir=${"], r"results_dir: \$\{ begins a reference .* are written \\\$\{"),
        (["~theta"], r"~theta: theta cannot be removed, only set to another value"),
        (
            ["~controller.theta"],
            r"unknown key 'controller\.theta'; did you mean 'controller\.path_cost\.theta'\?",
        ),
        (["~controller.horizon=3"], r"~controller\.horizon=3: controller\.horizon is .*, not 3"),
        (["~controller=ce"], r"~controller=ce: controller=ce is not chosen"),
        (["planner=3"], r"planner must be a mapping of settings, got 3"),
        (["planner=[1]"], r"planner must be a mapping of settings, got a list"),
        (["hydra.mode="], r"hydra\.mode must be one of RUN, MULTIRUN, got ''"),
        (["platform=[a]"], r"platform must be a text, got \['a'\]"),
        (["system=null"], rf"system=null: {OPTIONS}beacons, .*"),
        (["experiment=2026_11_30"], rf"experiment=2026_11_30: {OPTIONS}.*"),
        (["system=für"], rf"system=für: {OPTIONS}.*"),
        (["-m", "theta=1,-1"], r"theta must be at least 0, got -1"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_the_line_names_the_key_and_the_reason(args, line):
    with pytest.raises(ConfigError) as caught:
        collect(*args)
    assert re.fullmatch(line, str(caught.value))


@pytest.mark.parametrize(
    ("args", "named"),
    [
        (["theta=null"], "theta"),
        (["theta={a: 1}"], "theta"),
        (["theta=[1"], "[1"),
        (["theta"], "theta"),
        (["planner=null"], "planner"),
        (["~theta"], "theta"),
        (["~controller"], "controller"),
        (["hydra.mode=fast"], "hydra.mode"),
        (["--config-dir=/nowhere"], "/nowhere"),
        (["--cfg", "nothing"], "nothing"),
        (["--unknown"], "--unknown"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_whatever_else_goes_wrong_is_one_line_that_names_what_was_given(args, named):
    with pytest.raises(ConfigError) as caught:
        collect(*args)
    assert len(str(caught.value).splitlines()) == 1
    assert named in str(caught.value)


@pytest.mark.parametrize(
    "key",
    [
        "cost.gaol",
        "controller.horizn",
        "problem.obstacles.radus",
        "controller.wobs",
    ],
)
def test_what_is_suggested_exists(key):
    with pytest.raises(ConfigError, match=f"unknown key '{key}'") as caught:
        collect(f"{key}=1")
    for guess in re.findall(r"did you mean '(\S+)'", str(caught.value)):
        assert OmegaConf.select(OmegaConf.create(compose()), guess) is not None


def test_an_unforeseen_error_is_told_by_its_first_line_or_its_type():
    assert config_error_line(RuntimeError("\n  first\nsecond")) == "first"
    assert config_error_line(RuntimeError()) == "RuntimeError"
