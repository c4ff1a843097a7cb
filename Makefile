# `make` lists the commands. `make setup PYTHON=python3.12` chooses the interpreter; .venv then stays with it.
# `ROS=kilted` takes the later ROS 2 instead, in an environment of its own.

ROS ?= jazzy
VENV := .venv$(patsubst %,-%,$(filter-out jazzy,$(ROS)))
BIN := $(VENV)/bin
NEW := $(abspath $(VENV))-new
OLD := $(VENV)-old
LOCKS := requirements/base.txt requirements/$(ROS).txt
PACKAGES := $(VENV)/packages.done
READY := $(VENV)/ready.done
HEYOKA := $(VENV)/peer.done
COMPARED := $(VENV)/compared.done
STUDY := $(VENV)/study.done
BROWSER := $(VENV)/browser.done
SITE := $(VENV)/site.done
TYPES := $(VENV)/interface_types.done
BUILDERS := $(VENV)/builders.done
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet --quiet
PYTHON ?= python3

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

.PHONY: help setup demo view test test-slow check lint conflict-markers site package bench benchmark study documents accuracy paper literature map picture clean another-python

help:  ## list these commands
	@sed -n 's/^\([a-z -]*\):[^#]*## /  make \1\t/p' $(MAKEFILE_LIST) | expand -t 18

setup: $(READY) $(TYPES)  ## make .venv with every pinned package; quick when nothing has changed
	@echo "setup: $(VENV) is ready, with Python $$(cat $(PACKAGES))"

demo: $(READY) $(TYPES)  ## run robot and controller for about 20 s, record, report into out/
	@$(BIN)/python -m tools.demo

view: $(READY) $(TYPES)  ## run a robot and show it in the browser, at the address that is printed; VIEW="--open --port 0" gives options
	@$(BIN)/python -m tools.demo look $(VIEW)

# With another ROS 2 than Jazzy only the tests of ROS run, without the packages whose absence they skip.
TESTS := $(if $(filter jazzy,$(ROS)),test lab/test,test/ros lab/test/twin)
NEEDED := $(if $(filter jazzy,$(ROS)),$(HEYOKA) $(STUDY) $(BROWSER) $(SITE))

# Four workers on two cores, because half of the tests wait for processes.
test: $(READY) $(TYPES) $(NEEDED)  ## run the tests, four at a time, and those that need a quiet machine alone; with ROS=kilted those of ROS
	@$(BIN)/python -m pytest --numprocesses 4 --dist worksteal -m "not quiet and not slow" $(TESTS)
	@$(BIN)/python -m pytest -m quiet $$(grep -rl --include='*.py' 'mark\.quiet' $(TESTS))

test-slow: $(READY) $(TYPES) $(NEEDED)  ## run the tests of installation, documents, notebooks and demonstration as well
	@$(BIN)/python -m pytest --numprocesses 2 --dist loadfile -m slow $(TESTS)

# The rooms in which most changes are made; of them the tests without the mark `process`. They run as on a robot without the lab:
# the folder's sitecustomize.py refuses the lab and what only the lab needs, in every Python that they start.
QUICK := $(addprefix test/,test_rings.py solver model configuration simulation messages bag ros)

check: lint  ## the fast loop, a minute: lint, and the device's quick tests from solver to ros, without the lab's packages; says what it leaves out
	@PYTHONPATH=$(CURDIR)/test/without_lab $(BIN)/python -m pytest --numprocesses 2 --dist worksteal --quiet -m "not process and not quiet and not slow" $(QUICK)
	@echo "check: rooms left out: $(filter-out $(QUICK),$(patsubst %/,%,$(filter-out %__pycache__/ %without_lab/,$(wildcard test/*/ lab/test/*/))))"
	@echo "check: \`make test\` runs them and all of the above but installation and documents, which \`make test-slow\` runs"

lint: $(READY) conflict-markers site  ## check style, spelling, types, links and promised names; name generated pages that are stale
	@$(BIN)/ruff check
	@$(BIN)/oxlint --config=tools/oxlint.json --format=unix vibro_ros/view/page
	@$(BIN)/codespell *.md .github Makefile setup.py config docs examples lab test tools vibro_ros
	@$(BIN)/mypy --no-error-summary
	@$(BIN)/python -m tools.documents --check
	@$(BIN)/python -m tools.public_interface --check

# The theme would print in every build that its end of life is in May 2027, and that Zensical then takes mkdocs.yml over.
site: export NO_MKDOCS_2_WARNING := 1
site: $(READY) $(SITE)  ## build the documents as web pages into out/site; a link that leads nowhere is an error
	@said=$$($(BIN)/python -m mkdocs build --strict --config-file tools/mkdocs.yml 2>&1) || { echo "$$said" >&2; exit 1; }  # with --quiet it counts no warnings

# 1 of git's exit codes is "found nothing"; without a repository it looks at all files that .gitignore does not name.
conflict-markers:
	@git grep --no-index --exclude-standard -nIE '^([<]{7}|[|]{7}|={7}|[>]{7})( |$$)'; found=$$?; test $$found -eq 1 || { \
		echo "lint: a merge has left its marks in these lines; write what they should say" >&2; \
		exit 1; }

package: $(READY)  ## build wheel and sdist into out/dist, and try the wheel's robot from an empty folder; two minutes
	@$(BIN)/python -m tools.package

bench: $(READY) $(HEYOKA)  ## compare the exact solver's cost with fixed-step Runge-Kutta and heyoka
	@$(BIN)/python -m benchmark.costs

benchmark: $(READY) $(HEYOKA) $(COMPARED)  ## price accuracy against MuJoCo, Drake, SUNDIALS and others, half an hour; ONLY="6_device mujoco --quick" limits it
	@$(BIN)/python -m benchmark.run $(ONLY)

study: $(READY) $(STUDY)  ## short versions of all studies, figures and tables in out/study/short; ten minutes at most
	@$(BIN)/python -m research.paper --quick --output out/study/short/paper
	@$(BIN)/study sweep guide_angle --output out/study/short/sweep
	@$(BIN)/study optimise --quick --output out/study/short/optimise
	@$(BIN)/python -m research.literature --quick --output out/study/short/literature
	@$(BIN)/study orbits --quick --output out/study/short/orbits
	@$(BIN)/study diagram --quick --output out/study/short/diagram
	@$(BIN)/study basins --quick --set motor.speed=160 --output out/study/short/basins
	@$(BIN)/study map --quick --output out/study/short/map

documents: $(READY) $(HEYOKA) $(STUDY) $(COMPARED)  ## make the generated pages and pictures that are stale, up to two hours; ONLY="effects map" makes some
	@$(BIN)/python -m tools.documents $(ONLY)

accuracy paper literature map picture: $(READY) $(HEYOKA) $(STUDY)  ## make one of them: the same as make documents ONLY=...
	@$(BIN)/python -m tools.documents $@

clean:  ## remove every .venv and all that is built; out/ stays
	@rm -rf .venv .venv-* build install log *.egg-info .pytest_cache .ruff_cache .mypy_cache
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +
	@echo "clean: done"

# What pip leaves out of an editable installation, and `ros2 run`, `ros2 launch` and `ros2 pkg` look for: `ros2 launch` follows no
# link to a folder.
define LINK_PACKAGES
rm -rf $(addprefix $(VENV)/lib/,$(BOTH)) $(addprefix $(VENV)/share/,$(BOTH))
mkdir -p $(addprefix $(VENV)/lib/,$(BOTH)) $(addprefix $(VENV)/share/,$(BOTH)) $(VENV)/share/vibro_ros/launch $(VENV)/share/ament_index/resource_index/packages
ln -sf $(CURDIR)/resource/vibro_ros $(CURDIR)/lab/resource/vibro_lab $(VENV)/share/ament_index/resource_index/packages/
ln -s $(CURDIR)/package.xml $(CURDIR)/config $(VENV)/share/vibro_ros/
ln -s $(CURDIR)/lab/package.xml $(VENV)/share/vibro_lab/
ln -s $(CURDIR)/examples/launch/*.launch.py $(VENV)/share/vibro_ros/launch/
for package in $(BOTH); do \
	for name in $$($(BIN)/python -c "from importlib.metadata import distribution; print(*distribution('$$package').entry_points.names)"); do \
		ln -s ../../bin/$$name $(VENV)/lib/$$package/$$name || exit; done; done
endef

# The stamps are written last, so that an interrupted setup starts anew. A new environment is made beside the old one, which works
# until all packages are there; the paths that pip has written into the new one's scripts then get its name.
$(PACKAGES): export PIP_CONSTRAINT := requirements/base.txt  # empy comes as source; pip builds it with the pinned setuptools
$(PACKAGES): $(LOCKS)
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))' 2>/dev/null || { \
		echo "setup: $(PYTHON) is $$($(PYTHON) -V 2>/dev/null || echo missing), and Python 3.11 to 3.14 is needed;" \
			"name another one: make setup PYTHON=python3.12" >&2; \
		exit 2; }
	@echo "setup: making $(VENV) with $$($(PYTHON) -V)"
	@test -e $(VENV) || test ! -e $(OLD) || mv $(OLD) $(VENV)  # of a setup that was killed between the two moves below
	@$(PYTHON) -m venv --clear --prompt $(VENV) $(NEW)
	@echo "setup: installing $$(cat $(LOCKS) | grep -c ==) pinned packages (800 MB on disk; a minute or two)"
	@$(PIP:$(BIN)/%=$(NEW)/bin/%) install --use-pep517 --no-deps $(addprefix --requirement=,$(LOCKS)) || { \
		test ! -e $(VENV) || echo "setup: $(VENV) is as it was before" >&2; \
		exit 1; }
	@$(NEW)/bin/python -m pip check >/dev/null || { $(NEW)/bin/python -m pip check; exit 1; }
	@sed --in-place 's|$(NEW)|$(abspath $(VENV))|g' $$(grep --recursive --files-with-matches --binary-files=without-match \
		'$(NEW)' $(NEW)/bin $(NEW)/pyvenv.cfg)
	@rm -rf $(OLD)
	@test ! -e $(VENV) || mv $(VENV) $(OLD)
	@mv $(NEW) $(VENV)
	@rm -rf $(OLD)
	@$(BIN)/python -c 'import platform; print(platform.python_version())' > $@

BOTH := vibro_ros vibro_lab
# The kernels are built from the modules of the solver.
$(READY): $(PACKAGES) setup.py setup.cfg package.xml vibro_ros/process/executables.py examples/launch $(addprefix lab/,setup.py setup.cfg package.xml vibro_lab/executables.py) $(wildcard vibro_ros/solver/*.py vibro_ros/solver/*.h)
	@echo "setup: installing vibro_ros and vibro_lab from this folder, and building the kernels (half a minute)"
	@command -v $(firstword $(CXX)) >/dev/null || { \
		echo "setup: no C++ compiler ($(firstword $(CXX))); installing ziglang in its place (100 MB to load)"; \
		$(PIP) install --no-deps --requirement requirements/compiler.txt; }
	@$(PIP) install --use-pep517 --no-build-isolation --no-deps --editable . --editable lab
	@$(LINK_PACKAGES)
	@touch $@

# Only the build of types needs them; 30 MB to load.
$(BUILDERS): requirements/$(ROS)-types.txt $(PACKAGES)
	@echo "setup: installing cmake and ament, to build types"
	@$(PIP) install --only-binary :all: --no-deps --requirement $<
	@touch $@

# The command writes the stamp, unless there is no compiler that works: it then says so, and the robot runs without.
$(TYPES): $(BUILDERS) $(shell find tools/interfaces interfaces -type f -not -name '*.pyc')
	@$(BIN)/python -m tools.interfaces.command

# Only the studies need them.
$(STUDY): requirements/study.txt $(PACKAGES)
	@echo "setup: installing what the studies need"
	@$(PIP) install --only-binary :all: --no-deps --requirement $<
	@$(BIN)/python -m pip check >/dev/null || { $(BIN)/python -m pip check; exit 1; }
	@touch $@

# Only tests and screenshots of the view need them; 53 MB to load.
$(BROWSER): requirements/browser.txt $(PACKAGES)
	@echo "setup: installing Playwright, to steer a browser"
	@$(PIP) install --only-binary :all: --no-deps --requirement $<
	@$(BIN)/python -m pip check >/dev/null || { $(BIN)/python -m pip check; exit 1; }
	@touch $@

# Only the web pages of the documents need them; 110 MB on disk.
$(SITE): requirements/site.txt $(PACKAGES)
	@echo "setup: installing what makes web pages of the documents"
	@$(PIP) install --only-binary :all: --no-deps --requirement $<
	@$(BIN)/python -m pip check >/dev/null || { $(BIN)/python -m pip check; exit 1; }
	@touch $@

# Only what compares needs it, and the test with another vendor's DDS: 115 MB to load.
$(HEYOKA): requirements/bench.txt $(PACKAGES)
	@echo "setup: installing heyoka, to compare with, and Cyclone DDS, to talk with"
	@$(PIP) install --only-binary :all: --no-deps --requirement $<
	@$(BIN)/python -m pip check >/dev/null || { $(BIN)/python -m pip check; exit 1; }
	@touch $@

# Only `make benchmark` needs them, and it goes on without those that do not install here; 400 MB to load.
$(COMPARED): requirements/benchmark.txt $(PACKAGES)
	@echo "setup: installing the programs of the benchmark"
	@for one in $$(sed 's/#.*//' $<); do $(PIP) install --prefer-binary --no-deps $$one 2>/dev/null || \
		echo "setup: the benchmark goes on without $$one, which does not install here" >&2; done
	@touch $@
