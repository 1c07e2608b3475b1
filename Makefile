# Two commands on a fresh machine: `make demo` and `make test`. Each makes its own environment under .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
TWINS := models laws skills plants trials

.PHONY: demo test twins lint docs bench clean

demo: $(VENV)/.demo
	$(BIN)/comanip demo --out out

test: $(VENV)/.test
	$(BIN)/python -m pytest -n auto --dist worksteal

# What is compiled has a twin in Python, which runs where nothing was compiled: the rooms that have twins, once with these alone.
twins: $(VENV)/.test
	COMANIP_KERNELS=numpy $(BIN)/python -m pytest -n auto --dist worksteal $(addprefix tests/,$(TWINS))

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The site, from docs/, examples/ and docstrings, into build/site; a dead link is an error.
docs: $(VENV)/.dev
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet

# The peers live in an environment of their own. pomegranate brings torch; without it the table says absent.
# pbdlib is on no index: make bench PBDLIB=path takes a checkout of it. PARTS="em rollouts" measures only these again.
bench: .venv-bench/.ready
	.venv-bench/bin/python -m pip install --quiet --no-deps .
	OPENBLAS_NUM_THREADS=1 PBDLIB="$(abspath $(PBDLIB))" .venv-bench/bin/python benchmarks/report.py $(PARTS)

.venv-bench/.ready: pyproject.toml
	$(PYTHON) -m venv .venv-bench
	.venv-bench/bin/python -m pip install --quiet . hmmlearn gmr dynamax matplotlib pyarrow
	-.venv-bench/bin/python -m pip install --quiet pomegranate torch==2.13.0
	touch $@

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "comanip needs Python 3.11 or newer; $(PYTHON) is \
	$$($(PYTHON) --version 2>/dev/null || echo absent). Try: make $(MAKECMDGOALS) PYTHON=python3.12" >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.demo: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet -e ".[plot,humanoid]"
	touch $@

$(VENV)/.test: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet -e ".[test]"
	touch $@ $(VENV)/.demo

$(VENV)/.dev: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet -e ".[dev]"
	touch $@ $(VENV)/.test $(VENV)/.demo

clean:
	rm -rf $(VENV) .venv-bench out build
