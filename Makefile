# Everything runs in .venv, set up on first use with Python ≥ 3.11, make and git only:  make demo | make test
# Another interpreter: make PYTHON=python3.12 …

PYTHON ?= python3
VENV   := .venv
RUN    := $(VENV)/bin/python -m

# An environment that was moved, lost its interpreter or lacks a package is thrown away and set up anew.
ifneq ($(wildcard $(VENV)/.ready-*),)
SOUND := $(shell ($(RUN) pip check && $(VENV)/bin/python -c "import endoct.stitching as s, os; \
           raise SystemExit(not os.path.samefile(s.__path__[0], 'stitching'))") >/dev/null 2>&1 && echo yes)
ifneq ($(SOUND),yes)
$(shell rm -rf $(VENV))
endif
endif

# What commands start again and again is compiled once, whatever the environment says
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help demo test test-all gate lint types layers site page bench dist wheel-test lowest newest clean

help:
	@echo "make demo        simulate a bore, compare both recordings, write demo/comparison/report.html"
	@echo "make test        the tests (test-all: the slow ones too)"
	@echo "make gate        accuracy and doubts on worlds of all kinds, against the record"
	@echo "make lint        ruff: rules and format"
	@echo "make types       mypy, strict"
	@echo "make layers      import-linter: who may import whom"
	@echo "make site        the documentation as a site: open site/index.html"
	@echo "make page        the page's program, from its sources in TypeScript (needs Node and npm)"
	@echo "make bench       benchmarks against scikit-image"
	@echo "make dist        source archive and wheel of what is committed, in dist/: the same bytes anywhere"
	@echo "make wheel-test  build the wheel, install it into a clean environment, run it there"
	@echo "make lowest      the same with the lowest versions that pyproject.toml allows; newest: with the newest"
	@echo "make clean       remove the environment and everything built"

demo: $(VENV)/.ready-run
	$(VENV)/bin/endoct demo -o demo --overwrite
	@echo "The report: $(CURDIR)/demo/comparison/report.html (open it in a browser)"

# Each process begins with its third of the list, so that what a folder's tests share is made once; who is done helps.
# On two cores three are faster than two by a tenth: one of them mostly waits for a command or a browser
test: $(VENV)/.ready-dev
	@echo "Three processes look for the tests first (a quarter of a minute); then each dot is a test"
	$(RUN) pytest -m "not slow" --numprocesses=3 --dist=worksteal

test-all: $(VENV)/.ready-dev lowest newest
	$(RUN) pytest --numprocesses=3 --dist=worksteal

# Two processes of two threads each would wait for each other by turning round and round
gate: $(VENV)/.ready-dev
	OPENBLAS_NUM_THREADS=1 $(RUN) benchmarks.gate

lint: $(VENV)/.ready-dev
	$(RUN) ruff check
	$(RUN) ruff format --check

types: $(VENV)/.ready-dev
	$(RUN) mypy

layers: $(VENV)/.ready-dev
	$(VENV)/bin/lint-imports --no-logo --config layers.toml

site: $(VENV)/.ready-docs
	NO_MKDOCS_2_WARNING=1 $(RUN) mkdocs build --strict
	@echo "The site: $(CURDIR)/site/index.html (open it in a browser)"

page:
	cd workbench/page/frontend && npm ci --ignore-scripts --no-audit --no-fund && npm run check && npm run build

bench: $(VENV)/.ready-dev
	$(RUN) pytest benchmarks

dist: $(VENV)/.ready-dev
	.ci/dist $(VENV)/bin/python

wheel-test: $(VENV)/.ready-dev
	.ci/wheel-test $(VENV)/bin/python

lowest:
	.ci/bounds lowest $(PYTHON)

# With the newest Python that runs here
newest:
	.ci/bounds newest

clean:
	rm -rf $(VENV) build dist demo site *.egg-info .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis .benchmarks

$(VENV)/.ready-run: constraints.txt pyproject.toml setup.py
	$(call set-up,.)
	@echo "Compiling (half a minute, the first time only) …"
	@$(VENV)/bin/endoct warm-up >/dev/null
	touch $@

$(VENV)/.ready-dev: constraints.txt pyproject.toml setup.py
	$(call set-up,.[dev])
	touch $(VENV)/.ready-run $@

$(VENV)/.ready-docs: $(VENV)/.ready-dev
	$(call set-up,.[docs])
	touch $(VENV)/.ready-run $(VENV)/.ready-dev $@

# pip and setuptools come first and from the constraints, so that the build is as pinned as what is built
define set-up
	@$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11))" \
	  || { echo "endoct needs Python 3.11 or newer; $(PYTHON) is not. Try: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	@echo "Installing into $(VENV) (about a minute, the first time only) …"
	@$(RUN) pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear $(VENV)
	$(RUN) pip install --quiet --disable-pip-version-check --constraint constraints.txt pip setuptools
	PYTHONWARNINGS=ignore $(RUN) pip install --quiet --disable-pip-version-check --constraint constraints.txt --no-build-isolation --editable "$(1)"
endef
