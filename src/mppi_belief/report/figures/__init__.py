"""The figures of a report, drawn from results alone: those of Sec. VII, and diagnostics."""

from .animation import write_animation
from .certificate_panels import certificate_figure
from .diagnostics import ess_figure, residual_figure
from .figure_1 import figure_1
from .filter_consistency import consistency_figure
from .margins import margins_figure
from .one_trial import one_trial_figure
from .plane import kept_in_plane
from .quality import quality_figure
from .sampling_efficiency import proposals_figure
from .sensing import sensing_figure
from .style import BLUE, GREEN, INK, ORANGE, method_look, save_png, save_png_and_pdf
from .sweeps import figure_2, theta_figure
from .trajectories import (
    TRAJECTORIES_PNG,
    PathPanel,
    compare_paths,
    kept_panel,
    trajectories_figure,
)

__all__ = [
    "BLUE",
    "GREEN",
    "INK",
    "ORANGE",
    "TRAJECTORIES_PNG",
    "PathPanel",
    "certificate_figure",
    "compare_paths",
    "consistency_figure",
    "ess_figure",
    "figure_1",
    "figure_2",
    "kept_in_plane",
    "kept_panel",
    "margins_figure",
    "method_look",
    "one_trial_figure",
    "proposals_figure",
    "quality_figure",
    "residual_figure",
    "save_png",
    "save_png_and_pdf",
    "sensing_figure",
    "theta_figure",
    "trajectories_figure",
    "write_animation",
]
