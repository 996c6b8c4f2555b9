"""Runs examples/boat.ipynb and stores what its cells print and draw: `make picture`."""

import base64
import contextlib
import io
import json
import os
import sys
from pathlib import Path
from typing import Any

from mppi_belief.config.environment import prepare_drawing

NOTEBOOK = Path(__file__).parents[2] / "examples" / "boat.ipynb"
DPI = 72  # of the stored figures, which makes them small


def main() -> None:
    """Runs the notebook in its folder and writes it with outputs."""
    prepare_drawing()
    os.chdir(NOTEBOOK.parent)
    notebook = json.loads(NOTEBOOK.read_text())
    names: dict[str, Any] = {}
    codes = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for count, cell in enumerate(codes, start=1):
        cell["execution_count"] = count
        cell["outputs"] = run_cell("".join(cell["source"]), names)
    NOTEBOOK.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n")


def run_cell(source: str, names: dict[str, Any]) -> list[dict[str, Any]]:
    """Runs a cell in the namespace of the notebook; returns its outputs as a notebook has them."""
    import matplotlib.pyplot as plt

    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(source, str(NOTEBOOK), "exec"), names)
    outputs: list[dict[str, Any]] = []
    if printed.getvalue():
        text = printed.getvalue().splitlines(keepends=True)
        outputs.append({"name": "stdout", "output_type": "stream", "text": text})
    for number in plt.get_fignums():
        content = io.BytesIO()
        plt.figure(number).savefig(
            content, dpi=DPI, bbox_inches="tight", metadata={"Software": None}
        )
        png = base64.b64encode(content.getvalue()).decode()
        data = {"image/png": png, "text/plain": ["<Figure>"]}
        outputs.append({"data": data, "metadata": {}, "output_type": "display_data"})
    plt.close("all")
    return outputs


if __name__ == "__main__":
    sys.exit(main())
