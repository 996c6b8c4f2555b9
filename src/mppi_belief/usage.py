"""What `--help` of each command prints; that of `run` is Hydra's, in conf/config.yaml."""

USAGE = """\
usage: mppi-belief COMMAND [ARGS]

  run         run trials of a controller, or of a sweep     mppi-belief run controller=belief theta=1
              all keys and options:                         mppi-belief run --help
  report      tables, figures and a page from results       mppi-belief report
              of some studies, with other settings:         mppi-belief report experiment=table_1 n_trials=50
  verify      certificates of the paper's theorems          mppi-belief verify
              what of them holds for a system:              mppi-belief verify system=light_dark

  --version   print the version
  --help      print this

Tab completion in bash: eval "$(mppi-belief -sc install=bash)"
"""

REPORT = """\
usage: mppi-belief report [experiment=NAME[,NAME...]] [KEY=VALUE ...]

Reads what `mppi-belief run experiment=NAME` has left in results_dir, runs nothing, and writes tables
(LaTeX, Markdown, CSV), figures (PNG, PDF) and a page (index.html) into report_dir. KEY=VALUE as for run:
give the same settings. Without a name, all of: {studies}
and the certificates that `mppi-belief verify` has left in verify_dir.

Exit codes: 0 done, 2 bad input, 3 trials or certificates are missing (the report has what there is, and
says how to run the rest), 74 the report cannot be written.
"""

VERIFY = """\
usage: mppi-belief verify [CERTIFICATE ...] [seed=N] [workers=N] [verify_dir=DIR]
       mppi-belief verify KEY=VALUE ... [--config-dir DIR]

The first form computes certificates of the paper's statements, each a few numbers with the bands they
must lie in, and writes them with their figures into verify_dir. Without a name, all of:
{names}

The second says which statements hold for the system that KEY=VALUE describe (as for run), along the
belief of its trial 0: mppi-belief verify system=light_dark, or --config-dir mine system=mine.

Exit codes: 0 every certificate holds (or the second form was asked for), 1 one does not or could not be
computed, 2 bad input, 74 the results cannot be written, 130 or 143 stopped by a signal.
"""
