# Two commands on a machine with nothing but Python >= 3.11, pip and make: `make demo` and `make test`.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
CASES ?= 10000
SEED ?= 1
FOR ?= 180
SAMPLE ?= 500

.PHONY: help demo test lint docs tables messages vendored platforms versions figures fuzz chaos mutants clean pictures gallery

help:
	@echo "make demo   install photogram into $(VENV) and run the built-in simulated survey (results in demo/)"
	@echo "make test   install the test tools, then run ruff, mypy, import-linter and all tests"
	@echo "make test CHANGED=main   the same, with those tests alone that changes since main can reach"
	@echo "make test SEEDS=all     the same, with all seeds of the statistics that otherwise have ten, and whole surveys in full"
	@echo "make lint   ruff, mypy and import-linter alone"
	@echo "make tables write the tables of settings in docs/ anew from the code"
	@echo "make messages  bring the catalogs of the other languages up to what the code says in English"
	@echo "make vendored  take the libraries of the desk's map from their packages (needs npm)"
	@echo "make platforms  list which systems and Pythons photogram installs on from wheels alone, and their sizes (needs a network, 20 minutes)"
	@echo "make versions END=oldest   run demo and tests with the oldest versions of all libraries that are allowed; END=newest: the newest"
	@echo "make figures  run every benchmark whose figures the pages in docs/ show, and write docs/figures.json; many hours, goes on where it stopped"
	@echo "make figures ONLY=free_network   those alone whose command has this in it"
	@echo "make figures COMPARE=v0.3.0   run them here and at that commit over the same seeds, and say what moved"
	@echo "make docs   build the documentation with the reference of the public names as a site: build/site/index.html"
	@echo "make fuzz   try 10 000 spoilt inputs, the same ones each time (make fuzz SEED=2: others); some five minutes"
	@echo "make fuzz GUIDED=polygons FOR=180   inputs that reach new lines of a reader, for so many seconds (GUIDED=all: of each; needs atheris)"
	@echo "make chaos  kill surveys and the marking page at random, fail their changes of files, and give surveys wrong inputs: some 90 minutes on two cores"
	@echo "make mutants  change the adjustment's sources in 500 places, one at a time, and see whether the tests notice: two hours (SAMPLE=50: fewer)"
	@echo "make pictures PHOTOGRAPHS=folder   draw the first picture of the README anew, from the 18 photographs of Brighton Beach"
	@echo "make gallery DATA=folder   process five real surveys and write docs/gallery.md"
	@echo "make clean  delete $(VENV) and everything that the commands above made"

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "photogram needs Python 3.11 or newer; call make PYTHON=python3.11"; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: pyproject.toml $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	@touch $@

$(VENV)/installed-test: pyproject.toml $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[test]"
	@touch $@ $(VENV)/installed

$(VENV)/installed-docs: pyproject.toml $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[docs]"
	@touch $@ $(VENV)/installed

demo: $(VENV)/installed
	$(BIN)/photogram demo demo

lint: $(VENV)/installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: $(VENV)/installed-test
	PHOTOGRAM_SEEDS=$(SEEDS) $(BIN)/python tests/suite.py $(if $(CHANGED),--changed $(CHANGED))

tables: $(VENV)/installed
	$(BIN)/python tests/docs_tables.py

vendored:
	python3 tests/vendored.py

platforms: $(VENV)/installed-test
	$(BIN)/python tests/platforms.py

versions: $(VENV)/installed-test
	$(BIN)/python tests/versions.py $(END)

messages: $(VENV)/installed-test
	$(BIN)/python tests/messages.py

figures: $(VENV)/installed-test
	$(BIN)/python benchmarks/figures.py --only "$(ONLY)" --compare "$(COMPARE)"

docs: $(VENV)/installed-docs
	$(BIN)/python -m sphinx --fail-on-warning --keep-going -q -c docs/site -d build/site-trees . build/site
	@echo "Written: build/site/index.html"

fuzz: $(VENV)/installed-test
	PYTHONPATH=tests:tests/exchange $(BIN)/python tests/fuzz/$(if $(GUIDED),guided.py --target "$(GUIDED)" --seconds $(FOR),fuzz.py --cases $(CASES) --seed $(SEED))

chaos: $(VENV)/installed-test
	folder=$$(mktemp -d) && $(BIN)/python tests/chaos/interruptions.py "$$folder/survey" && rm -rf "$$folder"
	folder=$$(mktemp -d) && PYTHONPATH=tests $(BIN)/python tests/chaos/faults.py "$$folder/survey" --every 5 && rm -rf "$$folder"
	PYTHONPATH=benchmarks $(BIN)/python tests/chaos/marking_interruptions.py
	$(BIN)/python tests/chaos/wrong_inputs.py

mutants: $(VENV)/installed-test
	$(BIN)/python tests/mutants.py --sample $(SAMPLE) --seed $(SEED)

pictures: $(VENV)/installed-test
	@test -n "$(PHOTOGRAPHS)" || { echo "say where the 18 photographs of Brighton Beach are: make pictures PHOTOGRAPHS=folder"; exit 1; }
	mkdir -p build/beach
	test -f build/beach/project.yaml || $(BIN)/photogram init "$(PHOTOGRAPHS)" --project build/beach/project.yaml
	$(BIN)/photogram adjust build/beach/project.yaml
	$(BIN)/python docs/pictures/beach_survey.py build/beach/results docs/pictures/beach_survey.png
	@echo "Look at docs/pictures/beach_survey.png"

gallery: $(VENV)/installed-test
	@test -n "$(DATA)" || { echo "say where the five surveys are: make gallery DATA=folder"; exit 1; }
	$(BIN)/python docs/pictures/gallery.py "$(DATA)" build/gallery

clean:
	rm -rf $(VENV) demo fuzz-failures fuzz-inputs build dist *.egg-info
