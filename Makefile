PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
ARGS ?=
TEST_WORKERS ?= 2

.DEFAULT_GOAL := help
.PHONY: help install run report beyond verify calibration test test-faults test-long test-scenarios test-solver test-cluster check lint types layers style-report format bench bench-docs bench-compare bench-beyond bench-scale bench-cluster picture clean

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

$(VENV)/.installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' \
	  || { echo "Python 3.11, 3.12 or 3.13 is needed: make PYTHON=python3.11 ..." >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[dev,cluster]"
	@touch $@

install: $(VENV)/.installed  ## make the environment in .venv

run: install  ## the main job: MPPI-Belief, 200 trials, a table and a picture
	$(BIN)/mppi-belief run controller=belief theta=1 $(ARGS)

STUDIES := table_1 w_obs_sweep theta_sweep expectation diffusion horizon_and_samples quality_per_time

report: install  ## run what is missing of the paper's studies, then tables, figures and outputs/report/index.html
	@for study in $(STUDIES); do echo "== $$study"; \
	  $(BIN)/mppi-belief run experiment=$$study $(ARGS) || [ $$? -eq 3 ] || exit 1; done  # 3: some trials failed
	@echo "== certificates"; $(BIN)/mppi-belief verify $(filter seed=% workers=% verify_dir=%,$(ARGS)) || [ $$? -eq 1 ]  # 1: one fails
	$(BIN)/mppi-belief report $(ARGS)

BEYOND := information proposals two_lanes nonlinearity controlled_sensing platt_2010 van_den_berg_2012
comma := ,
space := $(subst ,, )

beyond: install  ## the studies beyond the paper, twenty minutes, into outputs/beyond/index.html
	@for study in $(BEYOND); do echo "== $$study"; \
	  $(BIN)/mppi-belief run experiment=$$study $(ARGS) || [ $$? -eq 3 ] || exit 1; done  # 3: some trials failed
	$(BIN)/mppi-belief report experiment=$(subst $(space),$(comma),$(BEYOND)) report_dir=outputs/beyond $(ARGS)

verify: install  ## certificates of the paper's theorems, a minute or two: outputs/verify/certificates.md
	$(BIN)/mppi-belief verify $(ARGS)

calibration: install  ## search the numbers the paper leaves open, half an hour a call; goes on where it stopped
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[dev,cluster,calibration]"
	$(BIN)/python experiments/calibration/search.py $(ARGS)

test: install  ## the test suite
	OMP_NUM_THREADS=1 NPROC=1 $(BIN)/python -m pytest -n $(TEST_WORKERS) --dist loadfile $(ARGS)

test-faults: install  ## everything a run must survive, a quarter of an hour: docs/reliability.md
	OMP_NUM_THREADS=1 NPROC=1 $(BIN)/python -m pytest -n $(TEST_WORKERS) --dist loadfile -m "long or not long" tests/faults $(ARGS)

test-long: install  ## certificates and reports of what goes beyond the paper, a minute or two
	OMP_NUM_THREADS=1 NPROC=1 $(BIN)/python -m pytest -n $(TEST_WORKERS) --dist loadfile -m long --ignore=tests/faults tests $(ARGS)

test-scenarios: install  ## ten thousand random scenarios of every controller in both precisions, half an hour
	OMP_NUM_THREADS=1 NPROC=1 $(BIN)/python tests/random_scenarios.py $(ARGS)

test-solver:  ## the trajectory optimiser against Crocoddyl (1 GB, in an environment of its own)
	$(PYTHON) -m venv $(VENV)-solver
	$(VENV)-solver/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[solver]"
	$(VENV)-solver/bin/python -m pytest -o addopts="-q" tests/solver

SLURM := tests/cluster/slurm_on_one_machine.sh

test-cluster: install  ## jobs of a real Slurm, which is set up here and torn down (as root, Debian 12, a quarter of an hour)
	$(SLURM) up
	OMP_NUM_THREADS=1 NPROC=1 $(BIN)/python -m pytest -o addopts="-q" tests/cluster $(ARGS); \
	  ended=$$?; $(SLURM) down; exit $$ended

check: lint types layers  ## linter, type checker and architecture check

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python docs/scripts/style_report.py --check --report-only

BEFORE ?=

style-report:  ## measure how readable the code is; BEFORE=COMMIT adds a column to compare with
	@$(PYTHON) docs/scripts/style_report.py $(if $(BEFORE),--before $(BEFORE)) $(ARGS)

types: install
	$(BIN)/mypy

layers: install
	$(BIN)/lint-imports

format: install  ## format the code
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: install  ## one control step of ours beside every MPPI library, into outputs/bench/ (the first time: minutes, 12 GB)
	$(BIN)/python benchmarks/control_step.py $(ARGS)

bench-docs: install  ## the same and the error with antithetic pairs, into docs/benchmarks.md too
	$(BIN)/python benchmarks/control_step.py --docs $(ARGS)
	$(BIN)/python benchmarks/variance.py --docs

COMMIT ?= HEAD

bench-compare: install  ## one control step of the working tree against COMMIT=..., interleaved: ratios
	$(BIN)/python benchmarks/compare.py $(COMMIT) $(ARGS)

bench-beyond: install  ## what goes beyond the paper takes of time beside what it stands in for: two minutes, into outputs/bench/
	$(BIN)/python benchmarks/beyond.py $(ARGS)

bench-scale: install  ## whole studies on 1 and 2 cores, many samples, long runs, wide sweeps, start-up: twelve minutes, into outputs/bench/
	$(BIN)/python benchmarks/scale.py $(ARGS)

bench-cluster: install  ## what handing out chunks and storing rows costs, into outputs/bench/
	$(BIN)/python benchmarks/cluster.py $(ARGS)

picture: install  ## what README and docs/theory.md show: 200 trials of MPPI-Belief and of CE-MPPI, one of each animated; certificates
	$(BIN)/mppi-belief run experiment=table_1 controller=belief,ce
	$(BIN)/python docs/readme_picture.py
	$(BIN)/mppi-belief verify cole_hopf feynman_kac control_law entropic_risk
	for name in cole_hopf feynman_kac control_law entropic_risk; do \
	  cp outputs/verify/$$name.png docs/img/theory_$$name.png; done

clean:  ## remove the environment and caches; results stay
	rm -rf $(VENV) $(VENV)-solver .venv-bench .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache
