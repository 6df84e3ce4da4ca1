# Two commands: make demo, make test. Each sets up what it needs, once.

.PHONY: demo test lint bench setup setup-test clean
.DELETE_ON_ERROR:

# What labcdp needs of Debian to run, and what its tests need beside that.
RUN_PACKAGES := python3-venv python3-gi gir1.2-aravis-0.8
TEST_PACKAGES := aravis-tools-cli aravis-tools chromium libatomic1 libreoffice-calc-nogui iproute2

PYTHON := .venv/bin/python

demo: setup
	.venv/bin/labcdp demo

test: setup-test lint
	$(PYTHON) -m pytest --numprocesses auto --dist loadfile

lint: setup-test
	tools/lint

# All but the comparison with Pyxel, which installs 1.5 GB.
bench: setup
	for file in benchmarks/bench_[!p]*.py; do $(PYTHON) "$$file"; done

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
	$(PYTHON) -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable .
	mkdir -p .setup
	touch $@

.setup/test: .setup/run
	$(PYTHON) -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	touch $@

clean:
	rm -rf .venv .setup build dist labcdp.egg-info labcdp-demo
