"""The figures of a report, from results alone: those of the paper (Sec. VII), and what goes on inside."""

from .animation import animate
from .consistency import consistency_figure
from .diagnostics import ess_figure, residual_figure
from .one_trial import one_trial
from .plane import kept_in_plane
from .proposals import proposals_figure
from .quality import quality_figure
from .sensing import sensing_figure
from .style import BLUE, GREEN, INK, ORANGE, look, save, save_both
from .sweeps import figure_2, theta_figure
from .theory import certificate_figure
from .trajectories import NAME, Run, compare, figure_1, trajectories

__all__ = [
    "BLUE",
    "GREEN",
    "INK",
    "NAME",
    "ORANGE",
    "Run",
    "animate",
    "certificate_figure",
    "compare",
    "consistency_figure",
    "ess_figure",
    "figure_1",
    "figure_2",
    "kept_in_plane",
    "look",
    "one_trial",
    "proposals_figure",
    "quality_figure",
    "residual_figure",
    "save",
    "save_both",
    "sensing_figure",
    "theta_figure",
    "trajectories",
]
