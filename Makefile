# harvester: `make run` validates the paper's scene three ways, `make test` runs every test.
# `make fast` tests the compiled device, or says why it is off.
# `make docs` writes the site to build/docs. Each sets up first what is missing; see .ci/setup for how, and for its options.

BIN := .venv/bin
STAMP := .venv/.complete

.PHONY: run test test-fast fast lint types docs setup clean

run: $(STAMP)
	$(BIN)/harvester validate paper --output results

# Modules run side by side, one a core. Their arrays are small: threads of BLAS only wait for each other.
test: $(STAMP)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist loadscope --no-loadscope-reorder -m "not exhaustive"

test-fast: $(STAMP)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist loadscope --no-loadscope-reorder

fast: $(STAMP)
	sh .ci/fast

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/hadolint Dockerfile

types: $(STAMP)
	$(BIN)/mypy

# Notebooks are executed where their code is new: after a change of the package, `make clean` first.
docs: $(STAMP)
	$(BIN)/python -m sphinx -c docs -b html --fail-on-warning --keep-going . build/docs

setup: $(STAMP)

$(STAMP): pyproject.toml .ci/setup
	@sh .ci/setup

# Results stay: they may have taken hours.
clean:
	rm -rf .venv build *.egg-info .mypy_cache .pytest_cache .ruff_cache
	find circuits harvester netlists tests -name __pycache__ -type d -prune -exec rm -rf {} +
