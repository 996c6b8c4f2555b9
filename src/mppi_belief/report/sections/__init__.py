"""The sections of the report: one module per study, and this list of them.

To give a study of your own a section, write a module here with a function that builds a `Section`
from the results of the study's cells, and add it to `FURTHER_STUDIES` under the name of the study's
file in conf/experiment/. A study without a section of its own is shown as a table of all its cells.
"""

from collections.abc import Callable
from pathlib import Path

from ..cell_results import CellResults, Studies
from ..elements import cell_lines, write_page_table
from ..page import Section
from .controlled_sensing import controlled_sensing_section
from .diffusion import diffusion_section
from .expectation import expectation_section
from .horizon_and_samples import horizon_and_samples_section
from .information import information_section
from .nonlinearity import nonlinearity_section
from .proposals import proposals_section
from .published_problems import platt_2010_section, van_den_berg_2012_section
from .quality_per_time import quality_per_time_section
from .reproduction import reproduction_sections
from .residual_along_trial import residual_sections
from .table_1 import table_1_section
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

FURTHER_STUDIES: dict[str, SectionBuilder] = {
    "information": information_section,
    "proposals": proposals_section,
    "controlled_sensing": controlled_sensing_section,
    "nonlinearity": nonlinearity_section,
    "two_lanes": two_lanes_section,
    "platt_2010": platt_2010_section,
    "van_den_berg_2012": van_den_berg_2012_section,
}


def study_sections(studies: Studies, folder: Path) -> list[Section]:
    """Builds every section of the studies that have results; writes their files into `folder`."""
    with_results = {
        name: cells for name, cells in studies.items() if any(len(cell.good) for cell in cells)
    }
    builders = PAPER_STUDIES | FURTHER_STUDIES
    sections = [
        builder(with_results[name], folder)
        for name, builder in builders.items()
        if name in with_results
    ]
    sections.extend(residual_sections(with_results.get("table_1", []), folder))
    sections.extend(reproduction_sections(with_results, folder))
    sections.extend(
        _general_section(name, cells, folder)
        for name, cells in with_results.items()
        if name not in builders
    )
    return sections


def _general_section(name: str, cells: list[CellResults], folder: Path) -> Section:
    """Builds the section of a study that has no module here: the table of its cells."""
    stem = name.replace("/", "_")
    return Section(
        name, [], [write_page_table(folder, stem, "All cells", cell_lines(cells), cells)]
    )
