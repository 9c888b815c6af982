# Two commands do everything: `make compare` and `make test`. Both set up .venv first, once.

PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.ready
SOURCES := pyproject.toml Cargo.toml Cargo.lock $(shell find gpx_lcp/rust -name '*.rs' -o -name 'Cargo.toml')

.PHONY: setup compare test check clean

setup: $(STAMP)

# An editable install in the release profile: the benchmarks refuse a debug build, and a changed .rs file rebuilds it.
$(STAMP): $(SOURCES)
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[bench,dev]'
	touch $(STAMP)

compare: setup
	$(BIN)/python -m benchmarks run stacks $(ARGUMENTS)

test: setup
	$(BIN)/python -m pytest

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest gpx_lcp._core
	cargo fmt --check
	cargo clippy --workspace --all-targets --all-features -- -D warnings
	cargo test --workspace

clean:
	rm -rf .venv target results gpx_lcp/*.so
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
