# `make compare`, `make report` and `make test` do everything. Each sets up .venv first, once.

PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.ready
SOURCES := pyproject.toml Cargo.toml Cargo.lock $(shell find gpx_lcp/rust -name '*.rs' -o -name 'Cargo.toml')

.PHONY: setup compare report pictures test check clean

setup: $(STAMP)

# An editable install in the release profile: the benchmarks refuse a debug build, and a changed .rs file rebuilds it.
$(STAMP): $(SOURCES)
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[bench,dev]'
	touch $(STAMP)

compare: setup
	$(BIN)/python -m benchmarks run stacks $(ARGUMENTS)
	$(BIN)/python -m benchmarks run stability --quick --out results/quick

# Suites that can be had --quick, and those that cannot. `check` certifies again what keeps impulses.
LADDERS := stability fclib qp presolve scaling acceleration analytic kernels
WHOLE := impacts overhead

# Every suite, and one page about all of them: results/report.html. ARGUMENTS=--quick makes it three minutes instead
# of 17. A suite with an attempt that ended in an error (exit code 1) is in the page, too.
report: compare
	for suite in $(LADDERS); do $(BIN)/python -m benchmarks run $$suite $(ARGUMENTS) || [ $$? -eq 1 ] || exit 1; done
	for suite in $(WHOLE); do $(BIN)/python -m benchmarks run $$suite || [ $$? -eq 1 ] || exit 1; done
	$(BIN)/python -m benchmarks check $(addprefix results/,stacks stability analytic fclib qp impacts presolve scaling acceleration)
	$(BIN)/python -m benchmarks report $(addprefix results/,stacks $(LADDERS) $(WHOLE))

# The pictures of README.md, from results/stacks and results/stability: `make report` writes both.
pictures:
	cp results/stacks/speed-accuracy-cold.png benchmarks/pictures/speed-accuracy.png
	cp results/stacks/speed-accuracy-cold.svg benchmarks/pictures/speed-accuracy.svg
	cp results/stability/map.png benchmarks/pictures/stability.png
	cp results/stability/map.svg benchmarks/pictures/stability.svg

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
