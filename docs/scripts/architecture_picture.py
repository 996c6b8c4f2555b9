"""Draws the rooms of the package and their imports: docs/img/architecture.svg.

Every row is a floor of the import rule, every box a room. An arrow means "imports"; an import is
not drawn where a longer way of arrows leads to the same room.

    python docs/scripts/architecture_picture.py
"""

from html import escape
from pathlib import Path
from typing import NamedTuple

from import_graph import ROOT, SOURCE, floors, room_imports, without_shortcuts

PICTURE = ROOT / "docs" / "img" / "architecture.svg"

# What a room is for, in a few words.
NOTES = {
    "__main__": "starts a command",
    "cli": "one module per command",
    "trial": "one closed loop",
    "verify": "certificates",
    "report": "tables and figures",
    "run": "carries out a plan",
    "trial_metrics": "cost, collisions, NEES",
    "controllers": "u from a belief",
    "filters": "a belief from y",
    "costs": "eq. (2)",
    "systems": "eqs. (1a)(1b)",
    "simulate": "the loop over time",
    "planning": "Sec. V-VI",
    "belief": "Sec. II, IV",
    "matching": "Sec. III, V-B",
    "results": "the results folder",
    "discretise": "eq. (18)",
    "config": "yaml to cells",
    "problem": "Sec. II: protocols",
    "obstacles": "shapes",
    "numerics": "array routines",
    "structs": "dataclasses for JAX",
    "array_fields": "arrays and their ranges",
    "fields": "ranges of values",
    "errors": "one-line errors",
}
# What a colour means, and the rooms that have it.
COLOURS = {
    "plug-in: one file each": (
        "#fdebd0",
        ["controllers", "filters", "costs", "systems", "obstacles"],
    ),
    "the paper's mathematics": (
        "#d6eaf8",
        ["planning", "belief", "matching", "discretise", "problem", "numerics", "simulate"],
    ),
    "no mathematics: runs, stores, reports": (
        "#e5f3e2",
        ["run", "results", "report", "config"],
    ),
}
OTHER_COLOUR = "#f2f2f2"

# The centres of boxes, px from the left, chosen so that few arrows cross. Other rooms are spread
# evenly over their floor.
PLACES = {
    "__main__": 560,
    "cli": 560,
    "trial": 160,
    "verify": 480,
    "report": 830,
    "run": 1020,
    "trial_metrics": 110,
    "simulate": 110,
    "controllers": 300,
    "filters": 480,
    "costs": 660,
    "systems": 840,
    "planning": 210,
    "belief": 400,
    "matching": 660,
    "results": 1020,
    "discretise": 530,
    "config": 1020,
    "problem": 530,
    "obstacles": 530,
    "numerics": 210,
    "structs": 530,
    "array_fields": 530,
    "errors": 1020,
    "fields": 770,
}

WIDTH = 1120  # px
BOX_WIDTH = 168
BOX_HEIGHT = 46
ROW = 92  # from floor to floor
TOP = 20


class Box(NamedTuple):
    """Represents the box of a room; px from the upper left corner of the picture."""

    room: str
    x: float  # centre
    y: float  # upper edge


def boxes() -> dict[str, Box]:
    """Returns the box of every room, the rooms of a floor side by side."""
    placed = {}
    for level, floor in enumerate(floors()):
        gap = WIDTH / len(floor)
        for position, room in enumerate(floor):
            x = PLACES.get(room, gap * (position + 0.5))
            placed[room] = Box(room, x, TOP + ROW * level)
    return placed


def colour(room: str) -> str:
    """Returns the colour of a room."""
    for fill, rooms in COLOURS.values():
        if room in rooms:
            return fill
    return OTHER_COLOUR


def arrow(upper: Box, lower: Box) -> str:
    """Returns the curve from the lower edge of one box to the upper edge of another."""
    start = upper.y + BOX_HEIGHT
    end = lower.y - 5
    bend = min(40, (end - start) / 2)
    return (
        f'<path d="M {upper.x:.0f} {start:.0f} C {upper.x:.0f} {start + bend:.0f}, '
        f'{lower.x:.0f} {end - bend:.0f}, {lower.x:.0f} {end:.0f}"/>'
    )


def box(placed: Box) -> str:
    """Returns the rectangle of a room with its name and its note."""
    left_edge = placed.x - BOX_WIDTH / 2
    note = NOTES.get(placed.room, "")
    name = placed.room + ("/" if (SOURCE / placed.room).is_dir() else ".py")
    return (
        f'<rect x="{left_edge:.0f}" y="{placed.y:.0f}" width="{BOX_WIDTH}" '
        f'height="{BOX_HEIGHT}" rx="6" fill="{colour(placed.room)}"/>\n'
        f'<text x="{placed.x:.0f}" y="{placed.y + 20:.0f}" class="name">{escape(name)}</text>\n'
        f'<text x="{placed.x:.0f}" y="{placed.y + 37:.0f}">{escape(note)}</text>'
    )


def legend(y: float) -> list[str]:
    """Returns what the colours mean, in one row at height `y`."""
    parts = []
    for position, (meaning, (fill, _)) in enumerate(COLOURS.items()):
        x = 40 + 320 * position
        parts.append(f'<rect x="{x}" y="{y:.0f}" width="18" height="18" rx="3" fill="{fill}"/>')
        parts.append(f'<text x="{x + 26}" y="{y + 14:.0f}" class="legend">{escape(meaning)}</text>')
    return parts


def picture() -> str:
    """Returns the picture as SVG; the same text for the same import graph."""
    placed = boxes()
    arrows = [
        arrow(placed[room], placed[lower])
        for room, imported in without_shortcuts(room_imports()).items()
        for lower in sorted(imported)
    ]
    height = TOP + ROW * len(floors()) + 20
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" '
        f'width="{WIDTH}" height="{height}">',
        "<title>Rooms of mppi_belief and their imports</title>",
        "<style>text { font: 12px sans-serif; text-anchor: middle; fill: #444 } "
        ".name { font: bold 14px monospace; fill: #111 } .legend { text-anchor: start } "
        "rect { stroke: #888 } path { fill: none; stroke: #8a94a6; stroke-width: 1.3; "
        "marker-end: url(#tip) }</style>",
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="6" refY="4" markerWidth="6" '
        'markerHeight="6" orient="auto"><polygon points="0,0 8,4 0,8" fill="#8a94a6"/>'
        "</marker></defs>",
        f'<rect width="{WIDTH}" height="{height}" fill="white" style="stroke: none"/>',
        *arrows,
        *map(box, placed.values()),
        *legend(height - 34),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def main(path: Path = PICTURE) -> None:
    """Writes the picture."""
    path.write_text(picture())


if __name__ == "__main__":
    main()
