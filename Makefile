# Everything runs in .venv, made here with the exact versions of constraints.txt.
# Needed on the machine: python3 >= 3.11 and make.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
PIP    := $(BIN)/python -m pip --disable-pip-version-check
# Tests run one process per core; numerical threads inside each of them would only get in the way.
PYTEST := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest

.DEFAULT_GOAL := help
.PHONY: help demo test check lint notebooks slow docs bench results constraints clean

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / {printf "  make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

demo: $(VENV)/.learn  ## learn a variable impedance skill and carry it to a new start (about 5 minutes)
	$(BIN)/vic demo

test: $(VENV)/.dev  ## fast tests, on all cores
	$(PYTEST) -n logical

check: lint test notebooks  ## ruff, pyright, fast tests, notebooks

lint: $(VENV)/.dev  ## ruff and pyright
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright --pythonpath $(BIN)/python

notebooks: $(VENV)/.dev  ## execute every notebook with small settings
	VIC_FAST=1 $(PYTEST) -n logical -m notebook

slow: $(VENV)/.dev  ## slow tests and notebooks
	VIC_FAST=1 $(PYTEST) -n logical -m "slow or notebook"

docs: $(VENV)/.docs  ## build the documentation into docs/_build/html; a warning is an error
	$(BIN)/sphinx-build -W --keep-going -q -b html docs docs/_build/html
	@echo "documentation: docs/_build/html/index.html"

bench: $(VENV)/.dev  ## measure simulation, collider, estimation, stability and learner; the last line of each is one JSON object
	$(BIN)/python -m benchmarks.simulation cup-on-plate
	$(BIN)/python -m benchmarks.simulation peg-in-hole
	$(BIN)/python -m benchmarks.collider
	$(BIN)/python -m benchmarks.estimation
	$(BIN)/python -m benchmarks.stability
	$(BIN)/python -m benchmarks.learner

results: $(VENV)/.dev  ## the paper's tables and figures, docs/results (some hours on 4 cores; stopped, it goes on)
	$(BIN)/vic study run studies/paper.toml --out runs/paper --resume
	$(BIN)/vic study report runs/paper --out docs/results

constraints:  ## resolve the dependencies anew in a throw-away environment and freeze them
	rm -rf build/constraints && $(PYTHON) -m venv build/constraints
	grep '^torch==' constraints.txt > build/torch.txt
	build/constraints/bin/python -m pip install -c build/torch.txt -e '.[all,dev,docs]'
	build/constraints/bin/python -m pip freeze --all --exclude-editable > build/frozen.txt
	{ grep '^#' constraints.txt; grep -v '^pip==' build/frozen.txt | sed 's/+.*//' | LC_ALL=C sort -f; } > build/new.txt
	mv build/new.txt constraints.txt && rm -rf build/constraints

clean:  ## remove what the targets made, .venv included
	rm -rf $(VENV) build dist docs/_build docs/api docs/notebooks .pytest_cache .ruff_cache .hypothesis
	find vic_toolbox tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +

# A stamp is written only after its install went through, so an interrupted one is simply done again.
$(VENV)/.made:
	@$(PYTHON) -c 'import sys; sys.exit("python3 >= 3.11 is needed, this is " + sys.version if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/.learn: pyproject.toml constraints.txt | $(VENV)/.made
	$(PIP) install -q -c constraints.txt -e '.[learn]'
	@touch $@

$(VENV)/.dev: pyproject.toml constraints.txt | $(VENV)/.made
	$(PIP) install -q -c constraints.txt -e '.[all,dev]'
	@touch $@ $(VENV)/.learn

$(VENV)/.docs: $(VENV)/.dev
	$(PIP) install -q -c constraints.txt -e '.[docs]'
	@touch $@
