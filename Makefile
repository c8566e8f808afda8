# make demo   set everything up and see the PERA move: log, picture, certificate and a page in results/position
# make test   set everything up and run the tests, but for the thesis's studies, which take longer than all others
# make test-all   all of them
# make docs   the documentation as a site, in site/index.html
# make lint   formatter, linter and type checker
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

# one BLAS thread each: parallel test processes with more would wait for each other
.PHONY: demo test test-all docs lint clean

demo: $(READY)
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

$(READY): pyproject.toml hatch_build.py phcontrol/_arrays.h phcontrol/_lazy_compiled.c phcontrol/mechanics/_triangular.h phcontrol/mechanics/_compiled.c phcontrol/mechanics/_compiled_frames.c phcontrol/safety/_vectors.h phcontrol/safety/_compiled.c phcontrol/safety/_compiled_program.c phcontrol/compilation/_caller.c
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable ".[dev]"
	touch $@

clean:
	rm -rf $(VENV) results site
