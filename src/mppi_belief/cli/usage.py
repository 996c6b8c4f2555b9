"""What `--help` of each command prints; that of `run` is Hydra's, in conf/config.yaml."""

USAGE = """\
usage: mppi-belief COMMAND [ARGS]

  run         run trials of a controller, or of a sweep     mppi-belief run controller=belief theta=1
              all keys and options:                         mppi-belief run --help
  report      tables, figures and a page from results       mppi-belief report
              of some studies, with other settings:         mppi-belief report experiment=table_1 n_trials=50
  verify      certificates of the paper's theorems          mppi-belief verify
              what of them holds for a system:              mppi-belief verify system=light_dark
  results     what is in the results folder                 mppi-belief results
              look into it, check it, tidy it:              mppi-belief results --help
  replay      run one trial again and compare               mppi-belief replay CELL TRIAL

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

RESULTS = """\
usage: mppi-belief results [results_dir=DIR]
       mppi-belief results show CELL
       mppi-belief results export --csv [CELL ...] [--to FILE]
       mppi-belief results compact [CELL ...]
       mppi-belief results verify [CELL ...]

The first form lists the cells: trials by status, settings, files, size, age, commit. CELL is the beginning of a
cell's id, or the path of its folder; results_dir=DIR goes with every form.

  show      configuration, runs (command, commit, machine), what went wrong, a summary, the files
  export    all rows as one CSV, numbers bit for bit; without CELL, of all cells that are not superseded
  compact   many small files of a cell become one of each kind; beside a running study, too
  verify    every file is read and checked against its hash, its cell and the other files

Exit codes: 0 done, 2 bad input, 3 verify found something wrong, 74 a file cannot be written.
"""

REPLAY = """\
usage: mppi-belief replay CELL TRIAL [results_dir=DIR] [--config-dir DIR] [--force]

Runs one trial of a cell again, from the configuration that its row was made with, compares everything that is
kept of it bit for bit, and draws it into the cell's folder. CELL is the beginning of a cell's id, or the path of
its folder. A controller or system of your own is looked for in --config-dir, and nowhere else.

  --force   run a trial again that ended its process (crashed) or did not end (timeout): in this process

Exit codes: 0 reproduced bit for bit, 2 bad input, 3 not reproduced, 74 the picture cannot be written.
"""
