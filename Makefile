# make demo   set everything up and see the PERA move: log, picture, certificate and a page in results/position
# make test   set everything up and run the tests, but for the thesis's studies, which take longer than all others
# make test-all   all of them
# make docs   the documentation as a site, in site/index.html
# make lint   formatter, linter and type checker
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
READY := $(VENV)/.ready

# one BLAS thread each: parallel test processes with more would wait for each other
.PHONY: demo test test-all docs lint clean

demo: $(INSTALLED)
	@echo "the PERA goes to a posture: simulated, certified at 256 states and recorded, in about a minute"
	$(BIN)/phcontrol run position --robot pera --out results/position --record results/position/position.html

TESTS := OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses auto --dist loadgroup

test: $(READY)
	$(TESTS) -m "not study"

test-all: $(READY)
	$(TESTS) $(if $(COSTS),--costs $(COSTS))

docs: $(READY)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

lint: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

SOURCES := pyproject.toml hatch_build.py phcontrol/_arrays.h phcontrol/_lazy_compiled.c phcontrol/mechanics/_triangular.h phcontrol/mechanics/_compiled.c phcontrol/mechanics/_compiled_frames.c phcontrol/safety/_vectors.h phcontrol/safety/_compiled.c phcontrol/safety/_compiled_program.c phcontrol/compilation/_caller.c

# what an arm needs to move: time is said, and pip says what it is at
$(INSTALLED): $(SOURCES)
	@echo "phcontrol and what it needs go into $(VENV): 1.4 GB, once, which takes some minutes"
	$(PYTHON) -m venv $(VENV)
	@date +%s > $(VENV)/.started
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --editable .
	@echo "installed in $$(($$(date +%s) - $$(cat $(VENV)/.started))) s"
	touch $@

# and what tests, pages and linters need
$(READY): $(INSTALLED)
	@echo "what tests, documentation and linters need goes into $(VENV): 1.2 GB more"
	$(BIN)/python -m pip install --quiet --editable ".[dev]"
	touch $@

clean:
	rm -rf $(VENV) results site
