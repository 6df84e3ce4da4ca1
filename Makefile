# Two commands: make demo, make test. Each sets up what it needs, once.

.PHONY: demo test test-long pytest lint bench docs validate setup setup-test setup-docs clean
.DELETE_ON_ERROR:

# What labcdp needs of Debian to run, and what its tests need beside that.
RUN_PACKAGES := python3-venv python3-gi gir1.2-aravis-0.8
TEST_PACKAGES := aravis-tools-cli aravis-tools chromium libatomic1 libreoffice-calc-nogui iproute2

PYTHON := .venv/bin/python

# Compiled modules are kept, or each of hundreds of processes would compile them again.
unexport PYTHONDONTWRITEBYTECODE

demo: setup
	.venv/bin/labcdp demo --force

# Both at once: pytest often waits, and mypy takes one processor.
test: setup-test
	@$(MAKE) --no-print-directory --jobs 2 lint pytest

# The matrices of the tests are small: with several processes, threads of the linear algebra wait for each other. Half of the
# time goes to waiting for devices, browsers and kills: twice as many processes as processors.
pytest: setup-test
	OMP_NUM_THREADS=1 $(PYTHON) -m pytest --numprocesses $$((2 * $$(nproc))) --dist loadfile --no-loadscope-reorder

# Minutes of what make test shows a part of: kills, faults in all states, long streams, all compiled loops.
test-long: setup-test
	$(PYTHON) -m pytest -m long

lint: setup-test
	tools/lint

# All but the comparison with Pyxel, which installs 1.5 GB.
bench: setup-test
	for file in benchmarks/bench_[!p]*.py; do $(PYTHON) "$$file"; done

# Every truth from outside with labcdp's deviation, in build/validation; LABCDP_EMVA_DATA names the folder of the EMVA
# 1288 reference sets. In a network of its own, where the simulated camera meets no other.
validate: setup-test
	$(if $(filter 0,$(shell id -u)),unshare --net sh -c 'ip link set lo up && exec "$$@"' sh) $(PYTHON) -m benchmarks.validation

# The site, from docs/ and examples/; needs no network once its packages are there. Open build/docs/index.html.
docs: setup-docs
	$(PYTHON) -m sphinx --fail-on-warning --keep-going --quiet --doctree-dir build/doctrees docs build/docs

# The packages are looked at each time: what could not be had once is asked for again.
setup:
	@tools/packages $(RUN_PACKAGES)
	@$(MAKE) --no-print-directory .setup/run
	@tools/receive-buffer

setup-test: setup
	@tools/packages $(TEST_PACKAGES)
	@$(MAKE) --no-print-directory .setup/test

.setup/run: pyproject.toml constraints.txt
	test -x $(PYTHON) || /usr/bin/python3 -m venv --system-site-packages .venv
	$(PYTHON) -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[all]'
	$(PYTHON) tools/compile
	mkdir -p .setup
	touch $@

.setup/test: .setup/run
	$(PYTHON) -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	touch $@

setup-docs: setup
	@$(MAKE) --no-print-directory .setup/docs

.setup/docs: .setup/run
	$(PYTHON) -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[docs]'
	touch $@

clean:
	rm -rf .venv .setup build dist labcdp.egg-info labcdp-demo
