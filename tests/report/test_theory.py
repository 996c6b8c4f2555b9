"""Certificates on the terminal, as files and on the page."""

import json

import numpy as np
import pandas as pd
import pytest

from mppi_belief.report.certificate_tables import show_certificates, show_system_certificate
from mppi_belief.report.figures import certificate_figure
from mppi_belief.report.sections import theory
from mppi_belief.results.certificate import CERTIFICATE_NAMES, Certificate, Line, Panel
from mppi_belief.results.certificate_files import (
    StoredCertificate,
    load_certificates,
    store_certificate,
)
from mppi_belief.verify.bands import at_least, at_most

SOURCE = {"commit": "4a7f400", "dirty": False, "seed": 7}


def certificate(name: str = "cole_hopf", value: float = 1e-13, panels: int = 2) -> Certificate:
    x = np.linspace(1.0, 2.0, 5)
    lines = [
        Line("line", x, x**2, "line", x**2 - 0.1, x**2 + 0.1),
        Line("points", x, x, "points", x - 0.2, x + 0.2),
    ]
    lines.append(Line("", x, 1 / x, "dashed"))
    figures_of_it = [Panel(f"panel {index}", "x (m)", "y", lines, "xy") for index in range(panels)]
    checks = [
        at_most("residual", value, 1e-12, "rounding"),
        at_least("size", 2.0, 1.0, "closed form"),
    ]
    return Certificate(name, f"Statement of {name}", f"What {name} covers.", checks, figures_of_it)


def stored(*certificates: Certificate) -> list[StoredCertificate]:
    return [StoredCertificate(item, 1.25, SOURCE) for item in certificates]


def test_what_is_stored_is_loaded_in_the_order_of_the_paper(tmp_path):
    for item in stored(certificate("feynman_kac"), certificate("cole_hopf")):
        store_certificate(tmp_path, item)
    loaded = load_certificates(tmp_path)
    assert [item.certificate.name for item in loaded] == ["cole_hopf", "feynman_kac"]
    assert loaded[0].source == SOURCE
    assert loaded[0].seconds == 1.25
    assert (
        load_certificates(tmp_path, ["feynman_kac"])[0].certificate.statement
        == "Statement of feynman_kac"
    )


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"certificate": {"checks": 3}}', "no json"])
def test_a_file_that_is_no_certificate_counts_as_missing(tmp_path, content):
    store_certificate(tmp_path, stored(certificate())[0])
    (tmp_path / f"{CERTIFICATE_NAMES[0]}.json").write_text(content)
    assert [item.certificate.name for item in load_certificates(tmp_path)] == ["cole_hopf"]


def test_the_terminal_shows_every_number_with_its_band_and_verdict(tmp_path, capsys):
    assert show_certificates(stored(certificate()), stored(certificate()), tmp_path)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "Statement of cole_hopf  (1.2 s)"
    assert lines[1].split() == ["residual", "1e-13", "≤", "1e-12", "holds"]
    assert lines[2].split() == ["size", "2", "≥", "1", "holds"]
    assert lines[-1].startswith("1 of 1 certificates hold, with 2 checks")


def test_a_failure_is_printed_and_returned(tmp_path, capsys):
    two = stored(certificate(), certificate("feynman_kac", value=1.0))
    assert not show_certificates(two, two, tmp_path)
    printed = capsys.readouterr().out
    assert printed.count("FAILS") == 1
    assert "1 of 2 certificates hold" in printed


def test_the_files_have_the_full_numbers_and_the_figures(tmp_path):
    both = stored(certificate(value=0.1 + 0.2), certificate("feynman_kac"))
    show_certificates(both[:1], both, tmp_path)
    numbers = pd.read_csv(tmp_path / "certificates.csv")
    assert numbers["value"][0] == 0.1 + 0.2
    assert list(numbers["holds"]) == [False, True, True, True]
    assert not (tmp_path / "feynman_kac.png").exists()
    assert (
        "| residual | 0.3 | ≤ 1e-12 | FAILS | rounding |"
        in (tmp_path / "certificates.md").read_text()
    )
    assert (tmp_path / "cole_hopf.png").read_bytes()[:4] == b"\x89PNG"
    assert (tmp_path / "cole_hopf.pdf").is_file()


def test_the_page_has_an_overview_and_a_section_for_each(tmp_path):
    first, item, failing = theory.theory_sections(
        stored(certificate(), certificate("feynman_kac", value=1.0, panels=0)), tmp_path
    )
    assert list(first.tables[0].frame["Verdict"]) == ["holds", "FAILS"]
    assert list(first.tables[0].frame["Hold"]) == ["2", "1"]
    assert theory.theory_provenance(stored(certificate())) == [("certificates", "4a7f400, seed 7")]
    assert theory.theory_provenance([]) == []
    assert item.title == "Statement of cole_hopf"
    assert [picture.file for picture in item.pictures] == ["theory_cole_hopf.png"]
    assert item.tables[0].bold == []
    assert failing.pictures == []
    frame = failing.tables[0].frame
    assert [frame.iat[cell] for cell in failing.tables[0].bold] == ["FAILS"]


def test_no_certificates_no_sections(tmp_path):
    assert theory.theory_sections([], tmp_path) == []
    assert certificate_figure([]) is None


def test_curves_are_drawn_as_they_say(tmp_path):
    figure = certificate_figure(certificate(panels=3).panels)
    assert len(figure.axes) == 3
    axes = figure.axes[0]
    line, points, dashed = axes.lines
    assert (line.get_linestyle(), points.get_linestyle(), dashed.get_linestyle()) == (
        "-",
        "None",
        "--",
    )
    assert len(axes.collections) == 2  # a band and bars
    assert (axes.get_xscale(), axes.get_yscale(), axes.get_xlabel()) == ("log", "log", "x (m)")
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["line", "points"]


def test_what_holds_for_a_system_is_written_beside(tmp_path, capsys):
    show_system_certificate(certificate("mine", value=1.0), tmp_path)
    printed = capsys.readouterr().out
    assert "does not hold" in printed
    assert "What mine covers." in printed
    assert "does not hold" in (tmp_path / "mine.md").read_text()
    assert list(pd.read_csv(tmp_path / "mine.csv")["holds"]) == [False, True]


def test_what_should_be_known_before_trusting_them():
    good = certificate()
    bad = certificate("feynman_kac", value=1.0)
    assert theory.theory_warnings(stored(good)) == []
    assert theory.theory_warnings(stored(good, bad)) == ["Statement of feynman_kac does not hold."]
    changed = [
        StoredCertificate(good, 1.0, SOURCE | {"dirty": True}),
        StoredCertificate(good, 1.0, SOURCE | {"commit": "0000000"}),
    ]
    assert [line.split()[0] for line in theory.theory_warnings(changed)] == ["Some", "The"]


def test_a_curve_with_a_hole_is_drawn_after_it_was_stored(tmp_path):
    hole = [0.5, float("nan"), 1.0]
    panel = Panel(
        "t", "x", "y", [Line("band", [1, 2, 3], hole, "line", hole, [2, 2, float("inf")])]
    )
    store_certificate(
        tmp_path, StoredCertificate(certificate()._replace(panels=[panel]), 1.0, SOURCE)
    )
    (loaded,) = load_certificates(tmp_path)
    assert np.isnan(loaded.certificate.panels[0].lines[0].y[1])
    certificate_figure(loaded.certificate.panels).savefig(tmp_path / "drawn.png")


@pytest.mark.parametrize("change", [{"source": None}, {"seconds": None}, {"source": [1]}])
def test_a_certificate_without_its_origin_counts_as_missing(tmp_path, change):
    store_certificate(tmp_path, stored(certificate())[0])
    path = tmp_path / "cole_hopf.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    assert load_certificates(tmp_path) == []
