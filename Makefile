# Two commands are enough: `make demo` and `make test`.
PYTHON ?= python3
BIN := .venv/bin
MINUTES ?= 20
SEED ?= 1
DAYS ?= 0

.PHONY: demo test lint check bench bench-traffic soak format docs clean

demo: .venv/runtime
	$(BIN)/fleetledger demo

test: .venv/dev
	$(BIN)/pytest --numprocesses auto --dist loadfile

lint: .venv/dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

check: lint test

bench: .venv/dev
	$(BIN)/python -m bench

bench-traffic: .venv/dev
	$(BIN)/python -m bench.traffic

soak: .venv/dev
	$(BIN)/python -m tests.soak --minutes $(MINUTES) --seed $(SEED)
	$(if $(filter-out 0,$(DAYS)),$(BIN)/python -m tests.soak_traffic --days $(DAYS))

format: .venv/dev
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

docs: .venv/dev
	$(BIN)/python -m fleetledger.documents
	$(BIN)/python -m tests.conformance.page

.venv/runtime: requirements/runtime.txt pyproject.toml
	test -d .venv || $(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --require-hashes -r requirements/runtime.txt
	$(BIN)/pip install --quiet --no-deps --no-build-isolation --editable .
	touch $@

.venv/dev: .venv/runtime requirements/dev.txt
	$(BIN)/pip install --quiet --require-hashes -r requirements/dev.txt
	touch $@

clean:
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache .hypothesis data
