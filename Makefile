# Everything happens in .venv; each target sets up what it needs where it is missing or older than pyproject.toml.
# What is installed is compiled to bytecode when first imported: most of it never is. Processes that may not keep that
# would each do it anew, a second and more.
unexport PYTHONDONTWRITEBYTECODE
PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo demo-cluster test test-more fuzz cuda lint bench studies docs release clean

demo: .venv/wvr
	$(BIN)/python -m studies.demo

demo-cluster: .venv/ready
	$(BIN)/python -m studies.demo_cluster

PYTEST := $(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder

# Of studies and benchmarks, each run in small, the fuzzer, the examples of docs/extending.md, what GPUs run, and whatever
# starts processes and ends them: a cluster, a browser, a notebook, Ctrl-C, full disks, kernels that cannot be kept.
MORE := tests/evidence tests/extending tests/fuzz tests/integrators/test_lone.py tests/test_cuda.py \
  tests/bricks/test_cluster.py tests/viewer/test_browser.py tests/viewer/test_widget.py tests/test_accessors.py \
  tests/test_disasters.py tests/test_interrupt.py tests/test_kernel_cache.py tests/test_launch.py

test: .venv/ready
	$(PYTEST) $(addprefix --ignore=,$(MORE))

test-more: .venv/ready
	$(PYTEST) $(MORE)

fuzz: .venv/ready
	$(BIN)/python -m tests.fuzz --minutes $(or $(MINUTES),10)

# Every kernel for CUDA, which needs no GPU; `make test-more` has a sample.
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
	$(BIN)/python -m pip install --quiet --no-compile --editable ".[docs]"
	touch $@

.venv/ready: .venv/wvr
	$(BIN)/python -m pip install --quiet --no-compile --editable ".[dev]"
	touch $@

.venv/wvr: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --no-compile --editable .
	touch $@

# The wheel is made of the sdist, and tried where nothing else is.
release: .venv/ready
	rm -rf build dist
	$(BIN)/python -m pip install --quiet build twine
	$(BIN)/python -m build --outdir dist
	$(BIN)/python -m twine check --strict dist/*
	$(PYTHON) -m venv build/tried
	build/tried/bin/python -m pip install --quiet dist/*.whl
	cd build && tried/bin/python -c "import numpy as n, wvr; a = n.indices((32,) * 3).sum(0) / 93; \
	  i = wvr.render(wvr.Volume(a), size=(64, 64)); i.save('a.png'); \
	  assert i.error_bound.max() <= 1 / 256; print(wvr.__version__, 'is ready')"
	build/tried/bin/wvr --version

clean:
	rm -rf .venv build dist out *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
