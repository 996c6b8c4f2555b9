"""Where a report's numbers come from, and the warnings that a reader gets and does not get."""

from typing import Any

import pytest

from mppi_belief.report.cell_results import CellResults
from mppi_belief.report.origin import trial_provenance, trial_warnings
from report_helpers import cell_of, failed_trial, results_of, trial_rows


def source(**changes: Any) -> dict[str, Any]:
    """What a part file says."""
    versions = {"mppi-belief": "0.1.0", "jaxlib": "0.7.1", "numpy": "2.3.2"}
    run = {
        "command": ["mppi-belief", "run", "experiment=table_1"],
        "started": "2025-01-01T10:00:00+00:00",
    }
    machine = {
        "platform": "Linux",
        "processor": "a processor",
        "commit": "4a7f400",
        "dirty": False,
        "algorithm": 1,
    }
    return run | machine | {"elapsed": 60.0, "versions": versions} | changes


def complete(*sources: dict[str, Any], **cell: Any) -> CellResults:
    return results_of(cell_of(**cell), trial_rows(200), 200, sources or [source()])


def provenance_of(cells: list[CellResults]) -> dict[str, str]:
    return dict(trial_provenance(cells))


OTHER_JAXLIB = source()["versions"] | {"jaxlib": "0.8.0"}
INSTALLED: dict[str, Any] = {"commit": None, "dirty": None}


@pytest.mark.parametrize(
    "sources",
    [
        [source()],
        [
            source(),
            source(
                started="2025-02-02T10:00:00+00:00", elapsed=1.0, command=["mppi-belief", "run"]
            ),
        ],
        [source(processor="another"), source()],
        [source(**INSTALLED), source(**INSTALLED)],
        [source(versions=source()["versions"] | {"pandas": "3"}), source()],
    ],
    ids=[
        "one",
        "two runs",
        "two machines",
        "an installed package",
        "other versions of what does not compute",
    ],
)
def test_complete_results_of_one_kind_have_no_warnings(sources):
    assert trial_warnings([complete(*sources), complete(*sources, method="ce")]) == []
    assert trial_warnings([complete(item) for item in sources]) == []


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"commit": "c03e45e"}, ["different commits", "4a7f400", "c03e45e"]),
        ({"versions": OTHER_JAXLIB}, ["different versions of jaxlib", "0.7.1", "0.8.0"]),
        ({"algorithm": 2}, ["different algorithm versions", "1", "2"]),
        (INSTALLED, ["different commits", "4a7f400", "installed package 0.1.0"]),
    ],
    ids=["commits", "jaxlib", "algorithm", "a checkout and an installed package"],
)
def test_results_of_two_kinds_are_one_warning_that_names_both(changed, words):
    mixed = [source(), source(**changed)]
    for cells in ([complete(*mixed)], [complete(origin) for origin in mixed]):
        (line,) = trial_warnings(cells)
        assert all(word in line for word in words)


def test_two_installed_versions_are_different():
    versions = [source()["versions"] | {"mppi-belief": name} for name in ("0.1.0", "0.2.0")]
    (line,) = trial_warnings(
        [complete(*(source(versions=names, **INSTALLED) for names in versions))]
    )
    assert "installed package 0.1.0; installed package 0.2.0" in line


def test_uncommitted_changes_give_a_warning():
    (line,) = trial_warnings([complete(source(dirty=True), source(dirty=True))])
    assert "uncommitted changes" in line
    clean_and_not = trial_warnings([complete(source(), source(dirty=True))])
    assert len(clean_and_not) == 2
    assert "4a7f400; 4a7f400 with changes" in clean_and_not[0]
    assert "uncommitted changes" in clean_and_not[1]


def test_fewer_trials_than_the_papers_give_a_warning():
    (line,) = trial_warnings([results_of(cell_of(), trial_rows(50), 50, [source()])])
    assert line.startswith("The report asks for 50 trials per cell, the paper has 200")
    own = results_of(cell_of(), trial_rows(50), 50, [source()], departures=None)
    assert trial_warnings([own]) == []
    assert trial_warnings([results_of(cell_of(), trial_rows(250), 250, [source()])]) == []


def test_missing_trials_are_counted_and_failed_ones_too():
    behind = results_of(cell_of("ce"), trial_rows(180), 200, [source()])
    none = results_of(cell_of("pipf"), [], 200)
    (line,) = trial_warnings([complete(), behind, none])
    assert line.startswith("2 of 3 cells are incomplete: 220 trials are missing")
    broken = [*trial_rows(197), *(failed_trial(trial) for trial in range(197, 200))]
    (line,) = trial_warnings([complete(), results_of(cell_of("ce"), broken, 200, [source()])])
    assert line.startswith("3 trials failed")
    broken = [*trial_rows(199), failed_trial(199)]
    (line,) = trial_warnings([results_of(cell_of("ce"), broken, 200, [source()])])
    assert line.startswith("1 trial failed")


def test_everything_at_once_is_a_line_each():
    rows = [*trial_rows(20), failed_trial(20)]
    cells = [
        results_of(
            cell_of(),
            rows,
            30,
            [source(dirty=True, commit="a"), source(versions=OTHER_JAXLIB, algorithm=2)],
        )
    ]
    lines = trial_warnings(cells)
    assert len(lines) == len(set(lines)) == 7
    assert not any("\n" in line for line in lines)


def test_provenance_names_every_commit_version_machine_seed_and_command_once():
    cells = [
        complete(source(), source(), seed=0),
        complete(
            source(
                **INSTALLED, processor="another", command=["mppi-belief", "run", "-m", "seed=0,1"]
            ),
            seed=1,
        ),
        results_of(cell_of("ce"), trial_rows(7), 200, [source(versions=OTHER_JAXLIB)]),
    ]
    provenance = provenance_of(cells)
    assert provenance["commit"] == "4a7f400; installed package 0.1.0"
    assert provenance["versions"] == "jaxlib 0.7.1; 0.8.0, mppi-belief 0.1.0, numpy 2.3.2"
    assert provenance["machine"] == "a processor, Linux; another, Linux"
    assert provenance["seeds"] == "0; 1"
    assert provenance["precision"] == "float32"
    assert provenance["trials"] == "407 in 3 cells"
    assert (
        provenance["commands"] == "mppi-belief run -m seed=0,1; mppi-belief run experiment=table_1"
    )


def test_wall_time_adds_over_runs_and_counts_each_run_to_its_last_trial():
    first = [source(elapsed=elapsed) for elapsed in (30.0, 90.0, 60.0)]
    second = source(started="2025-01-01T11:00:00+00:00", elapsed=30.0)
    cells = [complete(first[1], first[0]), complete(first[2], second, method="ce")]
    assert provenance_of(cells)["wall time"].startswith("2.0 min")


def test_files_that_say_little_or_nothing_do_not_stop_a_report():
    cells = [results_of(cell_of(), trial_rows(200), 200, [{"format": 1}])]
    assert trial_warnings(cells) == []
    assert provenance_of(cells)["commit"] == "installed package of unknown version"
    assert provenance_of(cells)["wall time"].startswith("0.0 min")


def test_nothing_has_no_origin():
    provenance = provenance_of([results_of(cell_of(), [], 200)])
    assert (provenance["commit"], provenance["commands"], provenance["trials"]) == (
        "-",
        "-",
        "0 in 1 cell",
    )
    assert trial_provenance([])
    assert trial_warnings([]) == []


def test_the_device_is_named_where_it_is_known():
    assert (
        provenance_of([complete(source(), source(device="NVIDIA H100"))])["device"] == "NVIDIA H100"
    )
    assert provenance_of([complete(source())])["device"] == "-"
