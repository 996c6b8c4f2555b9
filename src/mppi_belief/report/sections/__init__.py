"""The sections of the report: one module per study, and this list of them.

To give a study of your own a section, write a module here with a function that builds a `Section`
from the results of the study's cells, and add it to `FURTHER_STUDIES` under the name of the study's
file in conf/experiment/. Other studies and sweeps are shown by `own_study.py`.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

from ..cell_results import CellResults, Studies
from ..page import Section
from .controlled_sensing import controlled_sensing_section
from .diffusion import diffusion_section
from .expectation import expectation_section
from .horizon_and_samples import horizon_and_samples_section
from .information import information_section
from .margins import margins_section
from .nonlinearity import nonlinearity_section
from .own_study import OwnStudy, own_study_section
from .proposals import proposals_section
from .published_problems import platt_2010_section, van_den_berg_2012_section
from .quality_per_time import quality_per_time_section
from .reproduction import reproduction_sections
from .residual_along_trial import residual_sections
from .structures import structures_section
from .table_1 import table_1_section
from .table_1_long import table_1_long_section
from .theta_sweep import theta_sweep_section
from .two_lanes import two_lanes_section
from .w_obs_sweep import w_obs_sweep_section

SectionBuilder = Callable[[list[CellResults], Path], Section]  # from the cells, into the folder

# The studies of the paper; `mppi-belief report` shows these unless it is asked for others.
PAPER_STUDIES: dict[str, SectionBuilder] = {
    "table_1": table_1_section,
    "w_obs_sweep": w_obs_sweep_section,
    "theta_sweep": theta_sweep_section,
    "expectation": expectation_section,
    "diffusion": diffusion_section,
    "horizon_and_samples": horizon_and_samples_section,
    "quality_per_time": quality_per_time_section,
}

# The whole report shows these where they have results, and does not ask for them.
SUPPLEMENTS: dict[str, Callable[[Studies, Path], Section]] = {
    "table_1_long": table_1_long_section,
    "table_1_bumps": structures_section,
}

FURTHER_STUDIES: dict[str, SectionBuilder] = {
    "margins": margins_section,
    "information": information_section,
    "proposals": proposals_section,
    "controlled_sensing": controlled_sensing_section,
    "nonlinearity": nonlinearity_section,
    "two_lanes": two_lanes_section,
    "platt_2010": platt_2010_section,
    "van_den_berg_2012": van_den_berg_2012_section,
}


def study_sections(studies: Studies, folder: Path) -> list[Section]:
    """Builds the sections of `PAPER_STUDIES`, `FURTHER_STUDIES` and `SUPPLEMENTS` with results.

    Writes their files into `folder`. The order is that of the three lists.
    """
    with_results = {
        name: cells for name, cells in studies.items() if any(len(cell.good) for cell in cells)
    }
    builders = PAPER_STUDIES | FURTHER_STUDIES
    sections = [
        builder(with_results[name], folder)
        for name, builder in builders.items()
        if name in with_results
    ]
    sections.extend(
        build(with_results, folder) for name, build in SUPPLEMENTS.items() if name in with_results
    )
    sections.extend(residual_sections(with_results.get("table_1", []), folder))
    sections.extend(reproduction_sections(with_results, folder))
    return sections


def own_sections(studies: Sequence[OwnStudy], folder: Path, alone: bool) -> list[Section]:
    """Builds a section per study of other cells that has results; writes its files into `folder`.

    The section of a study that is `alone` on its page does not repeat the title of the page.
    """
    return [
        own_study_section(study, folder, "Results" if alone else study.title)
        for study in studies
        if any(len(cell.good) for cell in study.cells)
    ]
