# make demo | test | check | docs | first-hour | lowest | lock | clean. A fresh machine needs git, make and Python 3.11 or later, nothing else.
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
LOCK   := requirements-dev.lock
ARGS   ?=

# The matrices are small: threads inside the linear algebra cost more than they give, and pytest uses two processes.
export OPENBLAS_NUM_THREADS := 1
export OMP_NUM_THREADS := 1

.PHONY: demo test check docs first-hour lowest lock clean

demo: $(STAMP)
	env -u OMP_NUM_THREADS -u OPENBLAS_NUM_THREADS $(BIN)/casid demo --out out/demo $(ARGS)

# Without the campaigns, whole flights that are diagnosed one after the other: ARGS='-m slow' is these, ARGS='-m ""' all.
test: $(STAMP)
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "not slow" $(ARGS)

# Types are checked on one processor while the tests run; what they say stands behind the tests.
check: $(STAMP)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	@said=$$(mktemp); $(BIN)/pyright >$$said 2>&1 & types=$$!; \
	trap 'kill $$types 2>/dev/null' INT TERM; \
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "not slow" $(ARGS); tests=$$?; \
	wait $$types; wrong=$$?; echo pyright; cat $$said; rm -f $$said; \
	[ $$wrong -eq 0 ] && exit $$tests

# A virtual environment made by uv has no pip and one made by venv without ensurepip is half a one: hence the look for pip.
$(STAMP): pyproject.toml $(LOCK)
	@set -e; \
	if command -v uv >/dev/null 2>&1; then \
	  [ -x $(BIN)/python ] || uv venv --quiet --python '>=3.11' $(VENV); \
	  uv pip install --quiet --python $(BIN)/python -c $(LOCK) -e '.[dev]'; \
	else \
	  if ! $(BIN)/python -m pip --version >/dev/null 2>&1; then \
	    for python in python3.11 python3.12 python3.13 python3.14 python3 none; do \
	      $$python -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1 && break; \
	    done; \
	    [ $$python != none ] || { echo 'casid needs Python 3.11 or later on the PATH; found none' >&2; exit 1; }; \
	    $$python -m venv $(VENV); \
	  fi; \
	  echo 'Installing into $(VENV) (once)'; \
	  $(BIN)/python -m pip install --quiet --disable-pip-version-check -c $(LOCK) -e '.[dev]'; \
	fi; \
	touch $(STAMP)

# The pages, in docs/_build/html; a warning is an error.
docs: $(STAMP)
	MPLBACKEND=Agg $(BIN)/python -m sphinx -b html -W --keep-going -q docs docs/_build/html $(ARGS)

# What a new user does first, from the wheel in an environment of its own.
first-hour: $(STAMP)
	$(BIN)/python scripts/first_hour.py $(ARGS)

# The lowest versions that pyproject.toml allows, in an environment of their own: readers, exports, and the demonstration.
# Warnings of such old packages are no errors here. The lock has the newest ones.
LOWEST  := build/lowest
EXTRAS  := jsbsim,parquet,hdf5,excel,mdf,ulog,ardupilot,pandas
lowest: $(STAMP)
	@set -e; \
	uv=$$(command -v uv || true); \
	[ -n "$$uv" ] || { $(BIN)/python -m pip install --quiet --disable-pip-version-check uv; uv=$(BIN)/uv; }; \
	$$uv venv --quiet --clear --python $(BIN)/python $(LOWEST); \
	$$uv pip install --quiet --python $(LOWEST)/bin/python --resolution lowest-direct --only-binary :all: \
	  --no-binary casid -e '.[$(EXTRAS)]' pytest==8.2.0 hypothesis==6.100.0; \
	export MPLCONFIGDIR=$(LOWEST)/matplotlib; \
	$(LOWEST)/bin/python -m casid demo --quick --out $(LOWEST)/demo; \
	$(LOWEST)/bin/python -m pytest -q -p no:cacheprovider -W default \
	  tests/records/test_readers.py tests/records/test_foreign.py tests/formats/test_export.py tests/test_keeping.py $(ARGS)

# Needs uv. One lock for every platform and every Python that casid runs on.
lock:
	@echo '# Exact versions for development and the tests, used as pip constraints.' > $(LOCK)
	@echo '# Written by "make lock" from pyproject.toml.' >> $(LOCK)
	uv pip compile --quiet --upgrade --universal --python-version 3.11 --extra dev --no-annotate --no-header \
	  pyproject.toml >> $(LOCK)

# Leaves the environment alone: `rm -rf .venv` for a fresh one.
clean:
	rm -rf out build dist docs/_build docs/gallery docs/reference .pytest_cache .hypothesis .ruff_cache
	find casid problems scripts benchmarks tests -name __pycache__ -type d -prune -exec rm -rf {} +
