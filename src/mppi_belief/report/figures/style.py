"""Defines how figures look, one colour, marker and line per method, and writes them atomically.

The colours are those of Okabe and Ito, which are safe for colour blindness; vermillion is reserved
for collisions.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

import matplotlib as mpl
from matplotlib.figure import Figure

from ...results.files import write_whole

BLUE = "#0072B2"
ORANGE = "#D55E00"  # vermillion, for collisions only
GREEN = "#009E73"
INK = "#222222"
GREY = "#777777"
COLUMN = 3.5  # inches, the width of a column in a two-column paper
DPI = 200  # of every PNG
TITLE_CHARACTERS = 84  # in a line over a picture for the screen

# Larger pictures, for the screen.
SCREEN: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
}
# Figures of the width of a column, for print.
STYLE: Any = {
    **SCREEN,
    "font.size": 7.5,
    "axes.titlesize": 7.5,
    "axes.labelsize": 7.5,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "legend.handlelength": 2.0,
    "legend.columnspacing": 1.2,
    "legend.handletextpad": 0.5,
    "axes.linewidth": 0.6,
    "axes.titlepad": 3.0,
    "axes.labelpad": 2.0,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.width": 0.4,
    "xtick.minor.size": 1.5,
    "lines.linewidth": 1.1,
    "lines.markersize": 3.5,
    "hatch.linewidth": 0.5,
    "figure.constrained_layout.w_pad": 0.03,
    "figure.constrained_layout.h_pad": 0.03,
    "pdf.fonttype": 42,
}


class Look(NamedTuple):
    """Holds how one method is drawn in every figure."""

    colour: str
    marker: str
    line: Any  # a matplotlib linestyle


METHOD_LOOKS = {
    "belief": Look(BLUE, "o", "-"),
    "ce": Look("#CC79A7", "s", "--"),
    "pipf": Look(GREEN, "^", "-."),
    "ilqg": Look("#56B4E9", "D", (0, (1, 1))),
    "belief_joint": Look("#7B3294", "h", (0, (6, 1, 2, 1))),
    "chance": Look("#A6761D", "p", (0, (4, 1, 1, 1))),
    "algorithm_1": Look("#E69F00", "v", (0, (5, 1))),
    "oracle": Look("#000000", "P", (0, (3, 1, 1, 1))),
    "lqg": Look("#999999", "X", (0, (4, 2))),
}  # in the order of every figure
OTHER = Look("#555555", "*", "-")  # of a method that is not in `METHOD_LOOKS`


@contextmanager
def drawing_style(settings: Any) -> Iterator[None]:
    """Draws with Matplotlib's own defaults and these settings, whatever a matplotlibrc says.

    Matplotlib's settings are restored at the end. Figures are drawn on Agg canvases without pyplot,
    so no window system is asked for.
    """
    with mpl.rc_context():
        mpl.rcdefaults()
        with mpl.rc_context(settings):
            yield


def wrapped_title(title: str, columns: int = 1) -> str:
    """Returns a title in lines that fit over one of `columns` panels beside each other."""
    width = TITLE_CHARACTERS // columns
    return "\n".join(fill(line, width) for line in title.splitlines())


def method_look(method: str) -> Look:
    """Returns colour, marker and line of a method, an option of `controller`."""
    return METHOD_LOOKS.get(method, OTHER)


def method_order(method: str) -> int:
    """Returns the position of a method among the others in every figure; unknown ones are last."""
    return [*METHOD_LOOKS].index(method) if method in METHOD_LOOKS else len(METHOD_LOOKS)


def save_png(figure: Figure, path: Path) -> None:
    """Writes a PNG atomically."""
    with drawing_style(SCREEN):
        write_whole(path, lambda temporary: figure.savefig(temporary, dpi=DPI, format="png"))


def save_png_and_pdf(figure: Figure, folder: Path, stem: str) -> list[str]:
    """Writes STEM.png and STEM.pdf into a folder, each atomically; returns their names.

    The files hold no dates, so that a figure drawn from the same results is the same bytes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    undated: dict[str, Any] = {"png": {"Software": None}, "pdf": {"CreationDate": None}}
    for kind, metadata in undated.items():
        write = partial(figure.savefig, dpi=DPI, format=kind, metadata=metadata)
        with drawing_style(STYLE):
            write_whole(folder / f"{stem}.{kind}", write)
    return [f"{stem}.{kind}" for kind in undated]
