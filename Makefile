# make demo and make test work on a fresh clone with Python 3.11 or later.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo page test test-all bench lint wheels-check docs qgis-plugin site showcase package sources recipe released kernels clean

$(BIN)/eaves: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --upgrade pip
	$(BIN)/pip install --quiet --only-binary :all: --no-binary eaves --editable .[test,cluster]
	touch $@

# What a user installs, nothing of the tests; without pip and its bytecode, 0.1 GB less.
.demo/bin/eaves: pyproject.toml
	$(PYTHON) -m venv .demo
	.demo/bin/pip install --quiet --no-compile --only-binary :all: --no-binary eaves --editable .
	.demo/bin/pip uninstall --quiet --yes setuptools pip
	touch $@

demo: .demo/bin/eaves
	.demo/bin/eaves demo --out demo-out

# A process for each core; the tests of a file stay together, for they share what they build. Bytecode is kept,
# whatever the shell says: commands that tests start would compile the whole package each time.
test test-all: export PYTHONDONTWRITEBYTECODE :=
test: $(BIN)/eaves
	$(BIN)/python -m pytest -n auto --dist loadfile

test-all: $(BIN)/eaves
	$(BIN)/python -m pytest -n auto --dist loadfile -m "" tests benchmarks/speed/test_work.py

bench: $(BIN)/eaves
	$(BIN)/python -m pytest benchmarks/speed/test_work.py -m ""
	$(BIN)/python -m benchmarks

lint: $(BIN)/eaves
	$(BIN)/ruff check src tests benchmarks qgis
	$(BIN)/ruff format --check src tests benchmarks qgis
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python packaging/prose.py
	@if [ -d page/node_modules ]; then npm run --prefix page --silent check; \
	  else echo "page/node_modules is missing: the page's script is not checked (npm ci --prefix page)"; fi

# The scripts of a run's page, of the modules in page/src; needs node.
page: page/node_modules
	node page/build.js

page/node_modules: page/package-lock.json
	npm ci --prefix page
	touch $@

docs: $(BIN)/eaves
	$(BIN)/python -m docs.pictures
	$(BIN)/python -m docs.lighten
	$(BIN)/python -m docs.build

site: $(BIN)/eaves
	$(BIN)/pip install --quiet .[site]
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

# A wheel for all Pythons on this system, the compiled kernels in it, and the source; needs a C compiler.
package: $(BIN)/eaves
	$(BIN)/pip install --quiet build hatchling hatch-vcs
	HATCH_BUILD_HOOK_ENABLE_CUSTOM=1 $(BIN)/python -m build --no-isolation

# The source, and a wheel for any Python on any system, which compiles when it is first run.
sources: $(BIN)/eaves
	$(BIN)/pip install --quiet build hatchling hatch-vcs
	$(BIN)/python -m build --no-isolation

# Once, before the first release: pages and messages install from PyPI in place of the clone.
released:
	sed -i -E "s/install '\.\[/install 'eaves[/g; s/install \.( |$$|\`)/install eaves\1/; s/\`\.\[/\`eaves[/g" \
	  README.md docs/start.md docs/guides/*.md docs/sources/README.md src/eaves/formats/errors.py
	sed -i 's/ @ git+https:[^"\\]*//' docs/tutorials/first_buildings.ipynb

# The same kernels beside the sources of this clone, better improved than by its first run, or made anew.
kernels: $(BIN)/eaves
	$(BIN)/python packaging/kernels.py src/eaves

# The plug-in site wants ADDRESS=https://… of the repository, and EMAIL=…
qgis-plugin: $(BIN)/eaves
	$(BIN)/python -m qgis.package dist $(ADDRESS) $(EMAIL)

# The conda recipe of the source that `make sources` made.
recipe:
	sed -e "s/VERSION/$$(basename dist/eaves-*.tar.gz .tar.gz | cut -d- -f2)/" \
	  -e "s/CHECKSUM/$$(sha256sum dist/eaves-*.tar.gz | cut -d' ' -f1)/" packaging/conda/meta.yaml > dist/meta.yaml

# The page of a run as a folder for any web server: make showcase POINTS=delft.laz
showcase: $(BIN)/eaves
	$(BIN)/eaves build $(POINTS) -o showcase/run --overwrite
	$(BIN)/eaves export showcase/run --site showcase/web

wheels-check: $(BIN)/eaves
	$(BIN)/python benchmarks/wheels_check.py

clean:
	rm -rf $(VENV) .demo demo-out
