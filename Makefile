# Every target works first on a fresh clone with only Python >= 3.11 and make.
PYTHON ?= python3
BIN := .venv/bin
# Hundreds of processes start in a test run: what one has compiled serves the next, whatever the environment says.
export PYTHONDONTWRITEBYTECODE =

.PHONY: demo demo-diagnosis demo-experiment demo-live test test-quick soak kills limits calibration forms mutate lint bench bench-live validate blind real-data investigations docs changelog wheels clean

.venv/.runtime: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "haptic-driver needs Python >= 3.11; '$(PYTHON)' is older. Try: make $(MAKECMDGOALS) PYTHON=python3.12" >&2; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@rm -rf haptic_driver.egg-info  # an older one would hide kinds of devices that are new
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	@touch $@

.venv/.test: pyproject.toml .venv/.runtime
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[test]'
	@touch $@

demo: .venv/.runtime
	$(BIN)/haptic demo --out out/demo

demo-diagnosis: .venv/.runtime
	$(BIN)/python demos/demo_diagnosis.py --out out/demo-diagnosis

# The paper's experiment on a simulated rig with its stages and camera: some three minutes on two idle cores.
demo-experiment: .venv/.runtime
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[camera]'
	$(BIN)/python demos/demo_experiment.py --out out/demo-experiment

# In real time, on a machine that has nothing else to do; with a picture of the page where there is a Chromium.
demo-live: .venv/.test
	$(BIN)/python demos/demo_live.py --out out/demo-live

lint: .venv/.test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Pure tests, then tests with processes, then tests of real time alone: docs/house.md, "A test of each kind".
test: lint
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests

# Pure tests alone: a few minutes on two cores.
test-quick: .venv/.test
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests --quick

# Long tests and many repetitions, some two hours: those of a daemon's own pace alone, then the others, one a core.
SOAK := OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -m soak -rP --durations 30
ALONE := $(addprefix tests/,haptic_driver/daemon $(addprefix soak/test_,attack.py busy_machine.py demos.py everything_at_once.py fidelity.py rendering.py))
soak: .venv/.test
	status=0; $(SOAK) $(ALONE) || status=$$?; \
	$(SOAK) -n auto --dist loadfile --no-loadscope-reorder $(addprefix --ignore ,$(ALONE) tests/soak/test_kills.py) tests/soak tests && exit $$status

# 400 kills and stops of the daemon's processes beside 4 busy loops, with the time to zero: some 30 minutes.
kills: .venv/.test
	$(BIN)/python -m pytest -m soak -s tests/soak/test_kills.py

# Random models on random rigs: nothing that goes out exceeds a limit by the full model. At most 15 minutes.
limits: .venv/.test
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.limits

# Probabilities of the diagnosis, as stated and as they come true, on sets from its own hypotheses: at most 40 minutes.
calibration: .venv/.test
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.calibration

# How much of a gap effects in other forms close, and wrong ones: after a change of an effect's parameters. Some 15 minutes.
forms: .venv/.test
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.forms

# Small faults, one at a time, in what safety and truth rest on. Lines changed since BASE; ALL=1: a sample of everything.
BASE ?= HEAD~1
mutate: .venv/.test
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[mutate]'
	$(BIN)/python -m tests.mutation --base $(BASE) $(if $(ALL),--all)

bench: .venv/.test
	$(BIN)/python -m benchmarks

# Ten minutes of a finger that becomes moist, with a fixed model, with two gains and refit: some 3 minutes on two idle cores.
bench-live: .venv/.test
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks live

# The contact theory against a boundary-element solver: about 10 minutes on two cores; rewrites docs/validation.*.
validate: .venv/.runtime
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[validate]'
	$(BIN)/python -m validation

# The full suite at SCALE 1 has 5,300 sets and takes hours; what diagnoses never sees a label.
# SECOND=1, THIRD=1: 252 sets of other forms and other strangers instead, whatever SCALE says.
# MEASURED=1: 66 pairs, some 15 minutes: loads as measured, gains of trials and drifts in them, beside a twin without.
# Counts are printed after each pair; COUNTS asks for others. What is answered is kept: the same command goes on, with a greater SCALE too. Remove
# $(SETS)/answers.json when the diagnosis has changed.
SCALE ?= 0.1
SEED ?= 2
SECOND ?=
THIRD ?=
MEASURED ?=
COUNTS ?= $(if $(MEASURED),F1=66)
SETS = out/blind$(if $(SECOND),-second)$(if $(THIRD),-third)$(if $(MEASURED),-measured)
blind: .venv/.test
	$(BIN)/python -m tests.blind.generator --out $(SETS) --seed $(SEED) --scale $(SCALE) $(if $(COUNTS),--counts $(COUNTS)) $(if $(SECOND),--second) $(if $(THIRD),--third) $(if $(MEASURED),--measured) --workers 2
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.blind.evaluate --sets $(SETS) --out $(SETS)/results.md $(if $(MEASURED),--pairs)

# What must hold on measured data that the project does not ship; docs/real-data.md says where they are from.
DATA ?=
real-data: .venv/.test
	@test -n "$(DATA)" || { echo "make real-data DATA=folder; docs/real-data.md says which data" >&2; exit 2; }
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.real_data --data $(DATA) --out out/real-data $(if $(ANSWERS),--answers $(ANSWERS))

# haptic investigate against fingers of the blind generator, beside settings drawn at random: 1 to 3 minutes a finger.
FINGERS ?= W0=2,W1=10
investigations: .venv/.test
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.blind.investigations --seed $(SEED) --counts $(FINGERS) --out out/investigations-$(SEED)

docs: .venv/.runtime
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[docs]'
	$(BIN)/python docs/reference.py
	$(BIN)/python docs/verdict_figure.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	$(BIN)/python docs/count_words.py

# What the next release says: the news fragments of changes/, as a list.
changelog:
	@for file in changes/[!R]*.md; do [ -e "$$file" ] && sed '1s/^/- /; 2,$$s/^/  /' "$$file"; done; true

# The wheel, installed and run from an empty folder by every Python that this machine has, from 3.11 on.
wheels: .venv/.test
	$(BIN)/python -m pytest -m soak -rP tests/test_packaging.py

clean:
	rm -rf .venv out
