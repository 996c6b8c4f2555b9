PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
ARGS ?=
TEST_WORKERS ?= 2

.DEFAULT_GOAL := help
.PHONY: help install develop run report beyond results-page verify calibration test test-faults test-long test-scenarios test-solver test-cluster check lint types layers style-report format bench bench-docs bench-compare bench-beyond bench-scale bench-cluster picture clean

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-14s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

# Wheels are unpacked first and compiled on all cores then; pip would compile on one core.
PIP = $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt
COMPILE = $(BIN)/python -m compileall -qq -j 0 -x '/tests?/' src $(VENV)/lib || true

$(VENV)/.installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' \
	  || { echo "Python 3.11, 3.12 or 3.13 is needed: make PYTHON=python3.11 ..." >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(PIP) -e .
	@$(COMPILE)
	@touch $@

$(VENV)/.installed-dev: $(VENV)/.installed
	$(PIP) -e ".[dev,cluster]"
	@$(COMPILE)
	@touch $@

install: $(VENV)/.installed  ## make the environment in .venv

develop: $(VENV)/.installed-dev  ## add the tools of development and of clusters to .venv

run: install  ## run 200 trials of MPPI-Belief; print a table and draw a picture
	$(BIN)/mppi-belief run controller=belief theta=1 $(ARGS)

STUDIES := table_1 w_obs_sweep theta_sweep expectation diffusion horizon_and_samples quality_per_time

report: install  ## run what is missing of the paper's studies and report them in outputs/report/index.html
	@for study in $(STUDIES); do echo "== $$study"; \
	  $(BIN)/mppi-belief run experiment=$$study $(ARGS) || [ $$? -eq 3 ] || exit 1; done  # 3: some trials failed
	@echo "== certificates"; $(BIN)/mppi-belief verify $(filter seed=% workers=% verify_dir=%,$(ARGS)) || [ $$? -eq 1 ]  # 1: one fails
	$(BIN)/mppi-belief report $(ARGS)

BEYOND := margins information proposals two_lanes nonlinearity controlled_sensing platt_2010 van_den_berg_2012
comma := ,
space := $(subst ,, )

beyond: install  ## run the studies beyond the paper and report them in outputs/beyond/index.html (twenty-five minutes)
	@for study in $(BEYOND); do echo "== $$study"; \
	  $(BIN)/mppi-belief run experiment=$$study $(ARGS) || [ $$? -eq 3 ] || exit 1; done  # 3: some trials failed
	$(BIN)/mppi-belief report experiment=$(subst $(space),$(comma),$(BEYOND)) report_dir=outputs/beyond $(ARGS)

SUPPLEMENTS := table_1_long table_1_bumps platt_2010 van_den_berg_2012

results-page: report  ## run what docs/results.md shows beyond `report`, and fill it from the results (half an hour)
	@for study in $(SUPPLEMENTS); do echo "== $$study"; \
	  $(BIN)/mppi-belief run experiment=$$study $(ARGS) || [ $$? -eq 3 ] || exit 1; done  # 3: some trials failed
	$(BIN)/python docs/scripts/readme_picture.py
	$(BIN)/python docs/scripts/results_page.py $(ARGS)

verify: install  ## compute certificates of the paper's theorems into outputs/verify/certificates.md (two minutes)
	$(BIN)/mppi-belief verify $(ARGS)

calibration: develop  ## search the numbers that the paper leaves open; each call continues the search (half an hour)
	$(PIP) -e ".[dev,cluster,calibration]"
	$(BIN)/python experiments/calibration/search.py $(ARGS)

test: develop  ## run the test suite
	OMP_NUM_THREADS=1 NPROC=1 $(BIN)/python -m pytest -n $(TEST_WORKERS) --dist loadfile $(ARGS)

test-faults: develop  ## test everything that a run must survive, see docs/reliability.md (a quarter of an hour)
	OMP_NUM_THREADS=1 NPROC=1 $(BIN)/python -m pytest -n $(TEST_WORKERS) --dist loadfile -m "long or not long" tests/faults $(ARGS)

test-long: develop  ## test the slow certificates and reports beyond the paper (two minutes)
	OMP_NUM_THREADS=1 NPROC=1 $(BIN)/python -m pytest -n $(TEST_WORKERS) --dist loadfile -m long --ignore=tests/faults tests $(ARGS)

test-scenarios: develop  ## test every controller on ten thousand random scenarios in both precisions (half an hour)
	OMP_NUM_THREADS=1 NPROC=1 $(BIN)/python tests/random_scenarios.py $(ARGS)

test-solver:  ## test the trajectory optimiser against Crocoddyl in an environment of its own (1 GB)
	$(PYTHON) -m venv $(VENV)-solver
	$(VENV)-solver/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[solver]"
	$(VENV)-solver/bin/python -m pytest -o addopts="-q" tests/solver

SLURM := tests/cluster/slurm_on_one_machine.sh

test-cluster: develop  ## test on a real Slurm, which is set up here and removed again (root, Debian 12; a quarter of an hour)
	$(SLURM) up
	OMP_NUM_THREADS=1 NPROC=1 $(BIN)/python -m pytest -o addopts="-q" tests/cluster $(ARGS); \
	  ended=$$?; $(SLURM) down; exit $$ended

check: lint types layers  ## run the linter, the type checker and the check of the import rule

lint: develop  ## run the linter, the formatter's check and the checks of style
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python docs/scripts/style_report.py --check

BEFORE ?=

style-report:  ## measure how readable the code is; BEFORE=COMMIT adds a column to compare with
	@$(PYTHON) docs/scripts/style_report.py $(if $(BEFORE),--before $(BEFORE)) $(ARGS)

types: develop  ## run the type checker
	$(BIN)/mypy

layers: develop  ## check the import rule
	$(BIN)/lint-imports

format: develop  ## format the code
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: develop  ## time one control step beside every MPPI library, into outputs/bench/ (first time: minutes and 12 GB)
	$(BIN)/python benchmarks/control_step.py $(ARGS)

bench-docs: develop  ## run bench, measure antithetic pairs, and write both into docs/
	$(BIN)/python benchmarks/control_step.py --docs $(ARGS)
	$(BIN)/python benchmarks/variance.py --docs

COMMIT ?= HEAD

bench-compare: develop  ## time one control step of the working tree beside COMMIT=..., interleaved; print ratios
	$(BIN)/python benchmarks/compare.py $(COMMIT) $(ARGS)

bench-beyond: develop  ## time the methods beyond the paper beside what they replace, into outputs/bench/ (two minutes)
	$(BIN)/python benchmarks/beyond.py $(ARGS)

bench-scale: develop  ## measure whole studies, many samples, long runs, sweeps and start-up, into outputs/bench/ (twelve minutes)
	$(BIN)/python benchmarks/scale.py $(ARGS)

bench-cluster: develop  ## measure the costs of handing out chunks and of storing rows, into outputs/bench/
	$(BIN)/python benchmarks/cluster.py $(ARGS)

picture: develop  ## draw the pictures of README, docs/theory.md, docs/architecture.md and the notebook
	$(BIN)/mppi-belief run experiment=table_1 controller=belief,ce
	$(BIN)/python docs/scripts/readme_picture.py
	$(BIN)/mppi-belief verify cole_hopf feynman_kac control_law entropic_risk
	$(BIN)/python docs/scripts/architecture_picture.py
	$(BIN)/python docs/scripts/commands_page.py
	$(BIN)/python docs/scripts/run_notebook.py
	for name in cole_hopf feynman_kac control_law entropic_risk; do \
	  cp outputs/verify/$$name.png docs/img/theory_$$name.png; done

clean:  ## remove the environment and caches; results stay
	rm -rf $(VENV) $(VENV)-solver .venv-bench .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache
