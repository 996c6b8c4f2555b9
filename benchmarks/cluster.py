"""Measures the costs of a cluster: handing out chunks, and rows on disk and when they are read.

    python benchmarks/cluster.py [PART ...] [--quick] [--docs]

PART is `chunks` or `rows`; without one both are measured, which takes some minutes. Writes
outputs/bench/cluster.json and .md and prints the tables; `--docs` writes docs/cluster.md too.
`--quick` runs a little of each and writes nothing.
"""

import json
import sys

import scale
from document import write_between
from scaling import chunks, rows
from scaling.sizes import QUICK, Sizes

PARTS = {"chunks": chunks, "rows": rows}


def main(argv: list[str] | None = None) -> None:
    """Measures the chosen parts, writes the report and prints its tables."""
    options = scale.options_of(argv, PARTS, __doc__ or "")
    sizes = QUICK if options.quick else Sizes()
    report = {name: scale.measured(PARTS[name], sizes) for name in options.parts or PARTS}
    text = scale.markdown(report, PARTS)
    if not options.quick:
        (scale.OUTPUT / "cluster.json").write_text(json.dumps(report, indent=1))
        (scale.OUTPUT / "cluster.md").write_text(text + "\n")
    if options.docs:
        write_between("cluster", text)
    print(text)
    sys.exit(any("error" in part for part in report.values()))


if __name__ == "__main__":
    main()
