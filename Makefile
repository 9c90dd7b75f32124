# demo   the Ambler walks, then its task tree and Gantt chart        test    all tests but the long ones
# lint   format, lint, types, docs                                  bench   what messages cost here
# check  lint, and tests with coverage                              speed  the same beside others, and its page
# soak   all tests, on new random lives; then those of compiled        clean   away with what the others made
# docs   the site of the documents, in build/site
# pictures  the pictures of the documents, from real runs: a quarter of an hour on a quiet machine
# compiled  a wheel with machine code (central's core, the library's line) in build/wheel; their tests with it
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/ready
# three: many wait for processes of their own, and two do not keep two cores busy
AT_ONCE := -n 3 --dist loadfile
# two: what is of the soak keeps a core busy each
IN_PAIRS := -n 2 --dist loadfile

.PHONY: demo test lint check bench speed soak docs pictures compiled clean
.DELETE_ON_ERROR:

demo: $(READY)
	$(BIN)/python -m robots.ambler_sim --out walk --rocks 2

test: $(READY)
	$(BIN)/python -m pytest $(AT_ONCE)

lint: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy .
	$(BIN)/pyright
	$(BIN)/python -m dev.site

check: lint
	$(BIN)/python -m pytest $(AT_ONCE) --cov --cov-report=term:skip-covered

bench: $(READY)
	$(BIN)/python -m dev.benchmarks.messages

speed: $(READY)
	$(BIN)/python -m dev.benchmarks.messages --peers --json dev/records/speed.json
	$(BIN)/python -m dev.benchmarks.speed_page

soak: $(READY)
	$(BIN)/python -m pytest -m "" --new-lives $(IN_PAIRS)
	$(MAKE) compiled

docs: $(READY)
	$(BIN)/python -m dev.site

pictures: $(READY)
	$(BIN)/python -m dev.scripts.pictures

compiled: $(READY)
	rm -rf build/wheel build/compiled
	TCA_COMPILED=1 $(BIN)/python -m pip wheel -q --no-build-isolation --no-deps -w build/wheel .
	$(BIN)/python -m pip install -q --no-deps --target build/compiled build/wheel/*.whl
	PYTHONSAFEPATH=1 PYTHONPATH=$(CURDIR)/build/compiled:$(CURDIR) $(BIN)/pytest $(AT_ONCE) \
		-o "pythonpath=build/compiled ." tests/central tests/properties tests/module tests/integration

$(READY): setup.cfg pyproject.toml dev/scripts/setup.sh
	PYTHON=$(PYTHON) dev/scripts/setup.sh
	touch $@

clean:
	rm -rf .venv walk build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .coverage
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
