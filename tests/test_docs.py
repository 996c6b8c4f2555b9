"""What the documents point at is there."""

import re
from pathlib import Path

import pytest

from mppi_belief.results.certificate import CERTIFICATE_NAMES

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = sorted(
    [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "experiments").rglob("*.md")]
)


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_relative_links_lead_somewhere(document):
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", document.read_text()):
        if not target.startswith(("http:", "https:", "mailto:")):
            assert (document.parent / target).exists(), target


def test_every_certificate_is_named_wherever_certificates_are():
    modules = {
        path.stem for path in (ROOT / "src/mppi_belief/verify/certificates").glob("[!_]*.py")
    }
    assert modules == set(CERTIFICATE_NAMES)
    theory, paper_map = (
        (ROOT / "docs" / name).read_text() for name in ("theory.md", "paper_map.md")
    )
    for name in CERTIFICATE_NAMES:
        assert f"| `{name}` |" in theory
        assert f"`{name}`" in paper_map
        assert list((ROOT / "tests/verify").glob(f"test_{name}*.py"))
