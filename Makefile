# Everything happens in .venv, which is made here from pyproject.toml.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Modules are compiled when they are first imported: most never are.
INSTALL := $(BIN)/python -m pip install -q --disable-pip-version-check --no-compile
INTERFACES := $(wildcard idim_iv_interfaces/*.* idim_iv_interfaces/*/*.*)

# Compiled kernels stay with the environment, and with it outlive a fresh clone. Not for `demo`: the
# commands that a user gives afterwards look beside the sources.
KERNELS := $(CURDIR)/$(VENV)/numba
SOURCES := $(wildcard $(addprefix idim_iv_ros/,compilation.py simulation/*.py effects/*.py model/*.py))
collected tests check slow load bench $(VENV)/ready-kernels: export NUMBA_CACHE_DIR := $(KERNELS)

.PHONY: demo test check slow load lint types docs collected tests package bench clean

demo: $(VENV)/ready
	$(BIN)/python -m bags.demo --out out/demo

# Two cores: pip, mypy and kernels while the messages compile, tests are compiled while mkdocs runs.
test:
	@$(MAKE) --no-print-directory -j2 lint types $(VENV)/ready-tools $(VENV)/ready-kernels collected docs
	@$(MAKE) --no-print-directory tests

# Before a commit: tests that changed, and those that import a module that changed.
CHANGED = git diff --name-only HEAD --diff-filter=d; git ls-files --others --exclude-standard
check: lint types $(VENV)/ready-tools $(VENV)/ready-kernels
	@tests="$$({ ($(CHANGED)) | grep '^tests/.*/test_.*\.py$$'; \
		($(CHANGED)) | sed -n 's|/|.|g; s|^\(idim_iv_ros\..*\)\.py$$|\1|p' | \
		xargs -r -I{} grep -rlw --include='test_*.py' '{}' tests; } | sort -u)"; \
	[ -z "$$tests" ] || $(BIN)/pytest -n 2 --dist worksteal $$tests

lint: $(VENV)/packages
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-cache > $(VENV)/imports || { cat $(VENV)/imports; exit 1; }

types: $(VENV)/packages
	$(BIN)/mypy

# A broken link or a docstring that cannot be read fails; nothing is imported.
docs: $(VENV)/packages
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# A fresh clone's tests are compiled once, with their assertions explained, not by every worker at once.
collected: $(VENV)/ready-tools $(VENV)/ready-kernels
	@$(BIN)/pytest --collect-only -q > $(VENV)/collected || { cat $(VENV)/collected; exit 1; }

# Each worker has whole files; in the order of the folders, because the longest come first. One worker
# more than cores: half of what tests of nodes take is waiting.
tests: $(VENV)/ready-tools $(VENV)/ready-kernels
	$(BIN)/pytest -n 3 --dist loadfile --no-loadscope-reorder --max-worker-restart 2

# Both in dist/. The tests build them again from a copy of the sources, and install the wheel with what
# it depends on into an empty environment: a minute.
package: $(VENV)/ready-tools
	rm -rf dist build
	$(BIN)/python -m build --no-isolation .
	$(BIN)/pytest -m "slow or not slow" tests/packaging

# Monte Carlo studies and long recordings: about half an hour. One may take longer than a test that hangs.
slow: $(VENV)/ready-tools
	$(BIN)/pytest -m slow -o faulthandler_timeout=3600

# The recorder at high rates and a colcon build: about four minutes on an otherwise idle machine.
load: $(VENV)/ready-tools
	$(BIN)/pytest -m load

bench: $(VENV)/ready-bench
	$(BIN)/python -m benchmarks.decode
	$(BIN)/python -m benchmarks.simulation
	$(BIN)/python -m benchmarks.export
	$(BIN)/python -m benchmarks.figaroh
	$(BIN)/python -m benchmarks.long_recording
	$(BIN)/python -m benchmarks.recorder_rate
	$(BIN)/python -m benchmarks.recorder_variants
	$(BIN)/pytest -m bench -o faulthandler_timeout=3600

$(VENV)/bin/python:
	@echo "== making the Python environment $(VENV) with $$($(PYTHON) --version)"
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || \
		{ echo "Python 3.10 or newer is needed; say make PYTHON=/path/to/python3"; exit 1; }
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); \
		echo "== installing python3-venv from Debian"; \
		apt-get update -q && apt-get install -q -y python3-venv && $(PYTHON) -m venv $(VENV); }
	@$(INSTALL) --upgrade pip

$(VENV)/ready: $(VENV)/bin/python pyproject.toml
	@echo "== installing idim-iv-ros and its dependencies from PyPI"
	@$(INSTALL) -e .
	@touch $@

# The messages, services and actions, compiled in an environment of their own: about a minute.
$(VENV)/interfaces/built: $(VENV)/bin/python $(INTERFACES)
	@echo "== compiling idim_iv_interfaces"
	@rm -rf $(@D)
	@$(BIN)/python -m pip wheel -q --disable-pip-version-check --no-deps -w $(@D) ./idim_iv_interfaces
	@touch $@

# All that comes from PyPI at once, while the messages compile.
$(VENV)/packages: $(VENV)/bin/python pyproject.toml
	@echo "== installing idim-iv-ros, the ROS 2 wheels and the tools of tests and documentation from PyPI"
	@$(INSTALL) -e ".[docs,ros,test]"
	@touch $@ $(VENV)/ready

$(VENV)/ready-tools: $(VENV)/packages $(VENV)/interfaces/built
	@$(INSTALL) --force-reinstall --no-deps $(VENV)/interfaces/*.whl
	@touch $@

$(VENV)/ready-kernels: $(VENV)/packages $(SOURCES)
	@echo "== compiling the kernels of the simulation"
	@$(BIN)/python -m tests.compile_kernels
	@touch $@

$(VENV)/ready-bench: $(VENV)/ready-tools
	@echo "== installing the peers to compare with from PyPI"
	@$(INSTALL) -e ".[bench]"
	@touch $@

clean:
	rm -rf $(VENV) out build dist *.egg-info
