# `make` lists the commands. `make setup PYTHON=python3.12` chooses the interpreter; .venv then stays with it.
# `ROS=kilted` takes the later ROS 2 instead, in an environment of its own.

ROS ?= jazzy
VENV := .venv$(patsubst %,-%,$(filter-out jazzy,$(ROS)))
BIN := $(VENV)/bin
NEW := $(abspath $(VENV))-new
OLD := $(VENV)-old
# What a robot needs, and builds its kernels and types. Each of SETS adds what serves one purpose, from requirements/SET.txt.
LOCKS := $(addprefix requirements/,run.txt $(ROS).txt $(ROS)-types.txt)
SETS := test lint study site browser bench
PACKAGES := $(VENV)/packages.done
READY := $(VENV)/ready.done
TYPES := $(VENV)/interface_types.done
LAB := $(VENV)/lab.done
TEST := $(VENV)/test.done
LINT := $(VENV)/lint.done
STUDY := $(VENV)/study.done
SITE := $(VENV)/site.done
BROWSER := $(VENV)/browser.done
HEYOKA := $(VENV)/bench.done
COMPARED := $(VENV)/compared.done
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet --quiet
PYTHON ?= python3

# Kernels and types are built at the same time; packages are installed one list after the other (LOCKED).
MAKEFLAGS += --jobs=2
LOCKED := flock $(VENV)/pip.lock

# .venv holds its own ROS 2: a sourced installation must not be mixed in, nor another venv's mark that its libraries are found.
ifdef AMENT_PREFIX_PATH
unexport PYTHONPATH LD_LIBRARY_PATH
endif
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE
export AMENT_PREFIX_PATH := $(CURDIR)/$(VENV)

# An interpreter named by the caller wins over the one that .venv was made with.
ifneq ($(origin PYTHON),file)
ifneq ($(shell cat $(PACKAGES) 2>/dev/null),$(shell $(PYTHON) -c 'import platform; print(platform.python_version())' 2>&1))
$(PACKAGES): another-python
endif
endif

.PHONY: help setup demo view test test-slow test-settings check lint conflict-markers site package bench benchmark study documents accuracy paper literature map picture clean another-python

help:  ## list these commands
	@sed -n 's/^\([a-z -]*\):[^#]*## /  make \1\t/p' $(MAKEFILE_LIST) | expand -t 18

setup: $(READY) $(TYPES) $(LAB) $(TEST) $(LINT)  ## make .venv for work on the code, with tests and lab; quick when nothing has changed
	@echo "setup: $(VENV) is ready, with Python $$(cat $(PACKAGES))"

demo: $(READY) $(TYPES)  ## run robot and controller for about 20 s, record, report into out/
	@$(BIN)/python -m tools.demo

view: $(READY) $(TYPES)  ## run a robot and show it in the browser, at the address that is printed; VIEW="--open --port 0" gives options
	@$(BIN)/python -m tools.demo look $(VIEW)

# With another ROS 2 than Jazzy only the tests of ROS run, without the packages whose absence they skip.
TESTS := $(if $(filter jazzy,$(ROS)),test lab/test,test/ros lab/test/twin)
NEEDED := $(LAB) $(TEST) $(if $(filter jazzy,$(ROS)),$(LINT) $(HEYOKA) $(STUDY) $(BROWSER) $(SITE))

# Four workers on two cores, because half of the tests wait for processes.
test: $(READY) $(TYPES) $(NEEDED)  ## run the tests, four at a time, and those that need a quiet machine alone; with ROS=kilted those of ROS
	@$(BIN)/python -m pytest --numprocesses 4 --dist worksteal -m "not quiet and not slow" $(TESTS)
	@$(BIN)/python -m pytest -m quiet $$(grep -rl --include='*.py' 'mark\.quiet' $(TESTS))

test-slow: $(READY) $(TYPES) $(NEEDED)  ## run the tests of installation, documents, notebooks and demonstration as well
	@$(BIN)/python -m pytest --numprocesses 2 --dist loadfile -m "slow and not settings" $(TESTS)

test-settings: $(READY) $(TYPES) $(NEEDED)  ## halve and double each setting of fit, twin, map and continuation: an hour, for who changes one of them
	@$(BIN)/python -m pytest --numprocesses 2 --dist worksteal -m settings lab/test

# The rooms in which most changes are made; of them the tests without the mark `process`. They run as on a robot without the lab:
# the folder's sitecustomize.py refuses the lab and what only the lab needs, in every Python that they start.
QUICK := $(addprefix test/,test_rings.py solver model configuration simulation messages bag ros)

check: lint $(TEST)  ## the fast loop, a minute: lint, and the device's quick tests from solver to ros, without the lab's packages; says what it leaves out
	@PYTHONPATH=$(CURDIR)/test/without_lab $(BIN)/python -m pytest --numprocesses 2 --dist worksteal --quiet -m "not process and not quiet and not slow" $(QUICK)
	@echo "check: rooms left out: $(filter-out $(QUICK),$(patsubst %/,%,$(filter-out %__pycache__/ %without_lab/,$(wildcard test/*/ lab/test/*/))))"
	@echo "check: \`make test\` runs them and all of the above but installation and documents, which \`make test-slow\` runs"

lint: $(READY) $(LAB) $(LINT) conflict-markers site  ## check style, spelling, types, links and promised names; fail on a generated page that is stale
	@$(BIN)/ruff check
	@$(BIN)/oxlint --config=tools/oxlint.json --format=unix vibro_ros/view/page
	@$(BIN)/codespell *.md .github Makefile setup.py config docs examples lab test tools vibro_ros
	@$(BIN)/mypy --no-error-summary
	@$(BIN)/python -m tools.documents --check
	@$(BIN)/python -m tools.public_interface --check

# The theme would print in every build that its end of life is in May 2027, and that Zensical then takes mkdocs.yml over.
site: export NO_MKDOCS_2_WARNING := 1
site: $(READY) $(LAB) $(SITE)  ## build the documents as web pages into out/site; a link that leads nowhere is an error
	@said=$$($(BIN)/python -m mkdocs build --strict --config-file tools/mkdocs.yml 2>&1) || { echo "$$said" >&2; exit 1; }  # with --quiet it counts no warnings

# 1 of git's exit codes is "found nothing"; without a repository it looks at all files that .gitignore does not name.
conflict-markers:
	@git grep --no-index --exclude-standard -nIE '^([<]{7}|[|]{7}|={7}|[>]{7})( |$$)'; found=$$?; test $$found -eq 1 || { \
		echo "lint: a merge has left its marks in these lines; write what they should say" >&2; \
		exit 1; }

package: $(READY) $(LAB)  ## build wheel and sdist into out/dist, and try the wheel's robot from an empty folder; two minutes
	@$(BIN)/python -m tools.package

bench: $(READY) $(LAB) $(HEYOKA)  ## compare the exact solver's cost with fixed-step Runge-Kutta and heyoka
	@$(BIN)/python -m benchmark.costs

benchmark: $(READY) $(LAB) $(HEYOKA) $(COMPARED)  ## price accuracy against MuJoCo, Drake, SUNDIALS and others, half an hour; ONLY="6_device mujoco --quick" limits it
	@$(BIN)/python -m benchmark.run $(ONLY)

study: $(READY) $(LAB) $(STUDY)  ## short versions of all studies, figures and tables in out/study/short; ten minutes at most
	@$(BIN)/python -m research.paper --quick --output out/study/short/paper
	@$(BIN)/study sweep --scene paper --vary effects.normal_force=printed,unilateral --vary guide.angle=0.7:1.57:10 \
		--measure mean_speed delivered_power stick_share --output out/study/short/sweep
	@$(BIN)/study optimise --quick --output out/study/short/optimise
	@$(BIN)/python -m research.literature --quick --output out/study/short/literature
	@$(BIN)/study orbits --quick --output out/study/short/orbits
	@$(BIN)/study diagram --quick --output out/study/short/diagram
	@$(BIN)/study basins --quick --set motor.speed=160 --output out/study/short/basins
	@$(BIN)/study map --quick --output out/study/short/map

documents: $(READY) $(LAB) $(HEYOKA) $(STUDY) $(COMPARED)  ## make the generated pages and pictures that are stale, up to two hours; ONLY="effects map" makes some
	@$(BIN)/python -m tools.documents $(ONLY)

accuracy paper literature map picture: $(READY) $(LAB) $(HEYOKA) $(STUDY)  ## make one of them: the same as make documents ONLY=...
	@$(BIN)/python -m tools.documents $@

clean:  ## remove every .venv and all that is built; out/ stays
	@rm -rf .venv .venv-* build install log *.egg-info .pytest_cache .ruff_cache .mypy_cache
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +
	@echo "clean: done"

# What pip leaves out of an editable installation, and `ros2 run`, `ros2 launch` and `ros2 pkg` look for: `ros2 launch` follows no
# link to a folder. $(1) is the package, $(2) its folder here.
define LINK_PACKAGE
rm -rf $(VENV)/lib/$(1) $(VENV)/share/$(1)
mkdir -p $(VENV)/lib/$(1) $(VENV)/share/$(1)/launch $(VENV)/share/ament_index/resource_index/packages
ln -sf $(CURDIR)/$(2)/resource/$(1) $(VENV)/share/ament_index/resource_index/packages/
for file in $(CURDIR)/$(2)/package.xml $(wildcard $(CURDIR)/$(2)/config); do ln -s $$file $(VENV)/share/$(1)/; done
for file in $(wildcard $(CURDIR)/$(2)/examples/launch/*.launch.py); do ln -s $$file $(VENV)/share/$(1)/launch/; done
for name in $$($(BIN)/python -c "from importlib.metadata import distribution; print(*distribution('$(1)').entry_points.names)"); do \
	ln -s ../../bin/$$name $(VENV)/lib/$(1)/$$name || exit; done
endef

# The stamps are written last, so that an interrupted setup starts anew. A new environment is made beside the old one, which works
# until all packages are there; the paths that pip has written into the new one's scripts then get its name. It gets each of SETS
# that the old one has.
HAS = $(foreach set,$(SETS),$(if $(wildcard $(VENV)/$(set).done),$(set)))
$(PACKAGES): export PIP_CONSTRAINT := requirements/run.txt  # empy comes as source; pip builds it with the pinned setuptools
$(PACKAGES): $(LOCKS)
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))' 2>/dev/null || { \
		echo "setup: $(PYTHON) is $$($(PYTHON) -V 2>/dev/null || echo missing), and Python 3.11 to 3.14 is needed;" \
			"name another one: make setup PYTHON=python3.12" >&2; \
		exit 2; }
	@echo "setup: making $(VENV) with $$($(PYTHON) -V)"
	@test -e $(VENV) || test ! -e $(OLD) || mv $(OLD) $(VENV)  # of a setup that was killed between the two moves below
	@$(PYTHON) -m venv --clear --prompt $(VENV) $(NEW)
	@echo "setup: step 1 of 2: installing the $$(cat $(LOCKS) | grep -c ==) pinned packages that a robot needs (500 MB on disk)$(HAS:%=, and those of %)"
	@{ $(NEW)/bin/python -m pip --disable-pip-version-check install --progress-bar off --use-pep517 --no-deps \
			$(addprefix --requirement=,$(LOCKS) $(HAS:%=requirements/%.txt)) 2>&1 || touch $(NEW)/failed; } | tee $(NEW)/pip.log | awk \
		'/^(Collecting|Processing|Requirement)/ && ++n % 25 == 0 {print "setup: " n " packages loaded"; fflush()} \
		/^Installing collected/ {print "setup: all " n " packages loaded; unpacking them"; fflush()}'
	@test ! -e $(NEW)/failed || { \
		grep --invert-match --extended-regexp '^(WARNING|Collecting| )' $(NEW)/pip.log | tail -n 20 >&2; \
		test ! -e $(VENV) || echo "setup: $(VENV) is as it was before" >&2; \
		exit 1; }
	@$(NEW)/bin/python -I -m pip check >/dev/null || { $(NEW)/bin/python -I -m pip check; exit 1; }  # -I: not what PYTHONPATH has
	@sed --in-place 's|$(NEW)|$(abspath $(VENV))|g' $$(grep --recursive --files-with-matches --binary-files=without-match \
		'$(NEW)' $(NEW)/bin $(NEW)/pyvenv.cfg)
	@rm -rf $(OLD)
	@test ! -e $(VENV) || mv $(VENV) $(OLD)
	@mv $(NEW) $(VENV)
	@rm -rf $(OLD)
	@$(BIN)/python -c 'import platform; print(platform.python_version())' > $@
	@touch $@ $(HAS:%=$(VENV)/%.done)

# The kernels are built from the modules of the solver.
$(READY): $(PACKAGES) setup.py setup.cfg package.xml vibro_ros/process/executables.py examples/launch $(wildcard vibro_ros/solver/*.py vibro_ros/solver/*.h)
	@echo "setup: step 2 of 2: installing vibro_ros from this folder, and building its kernels (half a minute on two cores)"
	@command -v $(firstword $(CXX)) >/dev/null || { \
		echo "setup: no C++ compiler ($(firstword $(CXX))); installing ziglang in its place (100 MB to load)"; \
		$(LOCKED) $(PIP) install --no-deps --requirement requirements/compiler.txt; }
	@$(LOCKED) $(PIP) install --use-pep517 --no-build-isolation --no-deps --editable .
	@$(call LINK_PACKAGE,vibro_ros,.)
	@touch $@

# The command writes the stamp, unless there is no compiler that works: it then says so, and the robot runs without.
$(TYPES): $(PACKAGES) $(shell find tools/interfaces interfaces -type f -not -name '*.pyc')
	@$(BIN)/python -m tools.interfaces.command

$(LAB): requirements/lab.txt $(PACKAGES) $(addprefix lab/,setup.py setup.cfg package.xml vibro_lab/executables.py)
	@echo "setup: installing vibro_lab from the folder lab, and scipy"
	@$(LOCKED) $(PIP) install --use-pep517 --no-build-isolation --no-deps --requirement $< --editable lab
	@$(call LINK_PACKAGE,vibro_lab,lab)
	@touch $@

test_HAS := pytest, colcon, and what else the tests need
lint_HAS := what checks style, spelling and types
study_HAS := what the studies need
site_HAS := what makes web pages of the documents (110 MB on disk)
browser_HAS := Playwright, to steer a browser (53 MB to load)
bench_HAS := heyoka, to compare with, and Cyclone DDS, to talk with (115 MB to load)
$(SETS:%=$(VENV)/%.done): $(VENV)/%.done: requirements/%.txt $(PACKAGES)
	@echo "setup: installing $($*_HAS)"
	@$(LOCKED) $(PIP) install --only-binary :all: --no-deps --requirement $<
	@$(LOCKED) $(BIN)/python -m pip check >/dev/null || { $(BIN)/python -m pip check; exit 1; }
	@touch $@

# Only `make benchmark` needs them, and it goes on without those that do not install here; 400 MB to load.
$(COMPARED): requirements/benchmark.txt $(PACKAGES)
	@echo "setup: installing the programs of the benchmark"
	@for one in $$(sed 's/#.*//' $<); do $(LOCKED) $(PIP) install --prefer-binary --no-deps $$one 2>/dev/null || \
		echo "setup: the benchmark goes on without $$one, which does not install here" >&2; done
	@touch $@
