"""Whose code a configuration may name, and how it is told from what it was."""

import hashlib
import sys
from pathlib import Path

import pytest

from cli_helpers import restored
from mppi_belief.config import targets
from mppi_belief.config.targets import allow, fingerprints, locate
from mppi_belief.errors import ConfigError

REFUSED = r": must name a class of mppi_belief or of a module in a --config-dir folder"


def module(folder: Path, name: str, text: str) -> Path:
    file = folder / f"{name}.py"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
    return file


@pytest.mark.parametrize(
    "name",
    [
        "antigravity.X",
        "os.system",
        "mine.",
        ".mine.X",
        "mine",
        "",
        "a/b.C",
        "a..b",
        "mppi_beliefs.X",
        3,
        None,
        ["a.B"],
    ],
)
def test_what_is_nobodys_is_refused_without_importing_it(name, tmp_path):
    with restored():
        allow([tmp_path])
        with pytest.raises(ConfigError, match=REFUSED):
            locate(name, "controller")
        with pytest.raises(ConfigError, match=REFUSED):
            fingerprints({"controller": {"a": [{"_target_": name}]}}, [tmp_path])
    assert "antigravity" not in sys.modules


def test_only_modules_of_allowed_folders_are_imported(tmp_path):
    module(tmp_path, "only_here", "import math\nX = 1\nraised = 1\n")
    with restored():
        sys.path.insert(0, str(tmp_path))  # to be importable is not enough
        with pytest.raises(ConfigError, match=REFUSED):
            locate("only_here.X", "controller")
        assert "only_here" not in sys.modules
        allow([tmp_path])
        assert locate("only_here.X", "controller") == 1
        assert locate("mppi_belief.LQG", "controller").__name__ == "LQG"
        with pytest.raises(
            ConfigError, match=r"^controller\._target_=only_here\.Y: AttributeError: .*'Y'"
        ):
            locate("only_here.Y", "controller")
    assert str(tmp_path) not in targets.ALLOWED_FOLDERS


@pytest.mark.parametrize(
    "text",
    [
        "1 / 0",
        "raise SystemExit(3)",
        "import nowhere_at_all",
        "def",
        "raise RuntimeError('one\\ntwo')",
    ],
)
def test_a_module_that_cannot_be_imported_is_one_line(text, tmp_path):
    module(tmp_path, "fails_to_load", text)
    with restored():
        allow([tmp_path])
        with pytest.raises(
            ConfigError, match=r"^controller\._target_=fails_to_load\.X: \w+: "
        ) as caught:
            locate("fails_to_load.X", "controller")
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("name", ["time", "json", "pytest"])
def test_the_name_of_another_module_is_refused(name, tmp_path):
    module(tmp_path, name, "X = 1")
    with restored():
        allow([tmp_path])
        with pytest.raises(ConfigError, match=f"{name} is another module's name already"):
            locate(f"{name}.X", "controller")


def test_a_fingerprint_is_of_the_file_and_of_all_files_of_a_package(tmp_path):
    file = module(tmp_path, "mine_a", "X = 1\n1 / 0\n")
    module(tmp_path, "pack/__init__", "")
    inner = module(tmp_path, "pack/inner", "Y = 1")
    config = {
        "system": {"_target_": "mine_a.X", "o": {"_target_": "mppi_belief.Obstacles"}},
        "cost": {"a": "mine_b.X"},
    }
    assert fingerprints(config, [tmp_path]) == {
        "mine_a": hashlib.sha256(file.read_bytes()).hexdigest()[:12]
    }
    assert "mine_a" not in sys.modules
    package = {"system": {"_target_": "pack.Y"}}
    before = fingerprints(package, [tmp_path])
    inner.write_text("Y = 2")
    assert list(before) == ["pack"]
    assert fingerprints(package, [tmp_path]) != before
    assert fingerprints({"system": {"_target_": "mppi_belief.LightDark"}}, []) == {}
