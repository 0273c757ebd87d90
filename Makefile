# harvester: `make run` validates the paper's scene three ways. `make test` holds a test of every claim
# and takes eight minutes, `make test-fast` the quickest of them and two, `make test-all` all there are.
# `make fast` tests the compiled device, or says why it is off. `make faults` tells whether tests see
# faults that are put into copies.
# `make docs` writes the site to build/docs. Each sets up first what is missing: `make run` what
# running needs, the others the tests' tools too. See .ci/setup for its options.

BIN := .venv/bin
# What running needs, and what everything else needs.
RUNS := .venv/.complete
STAMP := .venv/.complete-test

.PHONY: run test test-fast test-all faults compare bench drawn netlists fast lint types docs setup clean

run: $(RUNS)
	$(BIN)/harvester validate paper --output results

# Tests run side by side, one process a core; whoever has none left takes from the other.
# Their arrays are small: threads of BLAS only wait for each other.
PYTEST := OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist worksteal

test: $(STAMP)
	$(PYTEST) -m "not exhaustive"

test-fast: $(STAMP)
	$(PYTEST)

test-all: $(STAMP)
	$(PYTEST) -m ""

# ONLY: words of titles or files; without it all of tests/maintenance/fault_list.py.
faults: $(STAMP)
	PYTHONPATH=tests $(BIN)/python -m maintenance.faults $(ONLY)

fast: $(STAMP)
	sh .ci/fast

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-cache
	$(BIN)/hadolint Dockerfile

types: $(STAMP)
	$(BIN)/mypy

# Both checkouts answer the same short cases; ONLY=text takes those whose name holds it.
compare: $(STAMP)
	PYTHONPATH=$(CURDIR):$(CURDIR)/tests $(BIN)/python -m maintenance.compare $(BASE) --only "$(ONLY)"

# Both checkouts do the same tasks by turns, COUNT times (9 unless given); ONLY as above.
bench: $(STAMP)
	PYTHONPATH=$(CURDIR):$(CURDIR)/tests $(BIN)/python -P -m maintenance.bench $(BASE) --only "$(ONLY)" \
		--runs $(or $(COUNT),9)

# COUNT random cases of every command against independent truths (44 unless given); ONLY=17,23
# repeats cases of this SEED, ONLY=words takes those with these words, such as basins,bistable.
drawn: $(STAMP)
	OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests $(BIN)/python -m maintenance.drawn --seed $(SEED) \
		--count $(or $(COUNT),44) --only "$(ONLY)"

# COUNT random loads (KIND=random or vendor) by Monte Carlo, circuit and plain ngspice; ONLY as above.
netlists: $(STAMP)
	OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests $(BIN)/python -m maintenance.netlists --seed $(SEED) \
		--count $(or $(COUNT),60) --kind $(or $(KIND),random) --only "$(ONLY)"

# Notebooks are executed where their code is new: after a change of the package, `make clean` first.
docs: $(STAMP)
	$(BIN)/python -m sphinx -c docs -b html --fail-on-warning --keep-going . build/docs

setup: $(STAMP)

$(RUNS): pyproject.toml .ci/setup
	@sh .ci/setup

$(STAMP): pyproject.toml .ci/setup
	@sh .ci/setup test

# Results stay: they may have taken hours.
clean:
	rm -rf .venv build *.egg-info .mypy_cache .pytest_cache .ruff_cache
	find circuits harvester netlists tests -name __pycache__ -type d -prune -exec rm -rf {} +
