# Everything happens in .venv; each target sets it up where it is missing or older than pyproject.toml.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo demo-cluster test fuzz cuda lint bench studies docs clean

demo: .venv/ready
	$(BIN)/python -m studies.demo

demo-cluster: .venv/ready
	$(BIN)/python -m studies.demo_cluster

test: .venv/ready
	$(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile

fuzz: .venv/ready
	$(BIN)/python -m tests.fuzz --minutes $(or $(MINUTES),10)

# Every kernel for CUDA, which needs no GPU; `make test` has a sample.
cuda: .venv/ready
	$(BIN)/wvr study cuda

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: .venv/ready
	$(BIN)/python -m benchmarks

studies: .venv/ready
	$(BIN)/wvr study --all $(if $(QUICK),--quick) $(if $(RESUME),--resume)

docs: .venv/docs
	$(BIN)/python -m sphinx -W --keep-going -q docs out/docs

.venv/docs: .venv/ready
	$(BIN)/python -m pip install --quiet --editable ".[docs]"
	touch $@

.venv/ready: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable ".[dev]"
	touch $@

clean:
	rm -rf .venv build out *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
