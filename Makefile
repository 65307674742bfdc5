# tailroad: see README.md. Everything is installed into .venv; nothing outside this folder is changed.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin

.PHONY: help estimate contacts committors test check lint docs bench bench-against bench-camera calibration calibration-peers other-measures guides faults attentive bench-fleet fuzz foreign-clients drivers a39 ego-vision schema example-ego pins wheel format clean

help:
	@echo "make estimate   install what the main job needs, and run it (minutes)"
	@echo "make contacts   how probable a contact of the lidar ego is among drivers who err (METHOD=, BUDGET=)"
	@echo "make test       install everything; format, lint, types, import contracts, documentation, tests"
	@echo "make check      the same without the tests"
	@echo "make docs       build the documentation into build/docs, and check it"
	@echo "make bench      measure the world's speed beside the bare SUMO loop"
	@echo "make bench-against  this checkout's processor time beside that of another commit, REV=... (half an hour)"
	@echo "make bench-camera  what a picture, the vision network and egos elsewhere cost (minutes)"
	@echo "make calibration  run every estimator on problems with known answers (an hour or more)"
	@echo "make calibration-peers  other libraries on the same problems (an hour)"
	@echo "make guides    follow the guides for newcomers word by word (minutes)"
	@echo "make faults     kill workers and scheduler many times, restart PostgreSQL, harm stores, play 10,000 random fleets (an hour or more)"
	@echo "make attentive  100,000 rollouts of drivers who look: none runs into the one ahead (minutes)"
	@echo "make bench-fleet  what the scheduler costs with 200 workers and over a million rollouts"
	@echo "make fuzz       100,000 wrong inputs to everything that reads from outside (ten minutes or more; goes on where it stopped)"
	@echo "make foreign-clients  build zenohd with its REST plugin and a client in Rust, and use the service by them (needs cargo; twenty minutes)"
	@echo "make drivers DATA=DIR  train the shipped weights again and remake their cards (hours on one core)"
	@echo "make a39 COPY=FILE  road, scenario, drivers and realism card of a recorded motorway (an hour)"
	@echo "make ego-vision  train the shipped vision ego again, with its card (an hour on one core; needs no data)"
	@echo "make committors  teach the committors of method paths again, with their cards (20 minutes on one core)"
	@echo "make schema     make the Python code of the egos' messages anew"
	@echo "make example-ego  build the example ego in Rust and drive with it (minutes; needs cargo)"
	@echo "make wheel      build the wheel and install it and all it needs in an empty environment (minutes)"
	@echo "make pins       hashes of what the image installs, its bill of materials and the licences, made anew"
	@echo "make format     put the sources into their form"

# Near-collisions by counting and by `auto`, which drives paths from the committor that comes with tailroad.
estimate: $(VENV)/.installed
	$(BIN)/tailroad estimate i80-paper-10s --ego lidar-paper --gamma 0.5 --method naive --method auto --budget 20000 --seed 1

# The committors that `paths` and `auto` start from, with their cards: the same bits on any processor.
committors: $(VENV)/.installed
	$(BIN)/tailroad train committor --scenario i80-paper-10s --ego lidar-paper --ego lidar --aim 0.7 --aim 0.55 --aim 0.45 --aim 0.35 --aim 0.28 \
	  --naive 3000 --rounds 25 --steps 10000 --seed 1 --out $(WEIGHTS)
	$(BIN)/tailroad train committor --scenario i80-10s --ego lidar-paper --ego lidar --aim 3.0 --aim 2.0 --aim 1.0 --aim 0.0 --aim 0.0 \
	  --naive 3000 --rounds 25 --steps 10000 --seed 1 --out $(WEIGHTS)

# Contacts of the ego `lidar` among drivers who err, counted and by METHOD; one in some 10^5 to 10^6 drives, too rare for
# counting in minutes.
METHOD ?= paths
BUDGET ?= 20000
contacts: $(VENV)/.installed
	$(BIN)/tailroad estimate i80-10s --ego lidar --gamma 0 --method naive --method $(METHOD) --budget $(BUDGET) --seed 1

# Test files are spread over the cores, four at most: many of them start processes of their own. The slowest are begun first, and the
# types are checked beside them, which keeps one core busy.
# One of them builds the documentation.
test: $(VENV)/.installed-dev
	$(MAKE) -j2 lint suite

suite: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder

check: lint docs

lint: $(VENV)/.installed-dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# From this folder alone, nothing is fetched. Dead links, pages that no page leads to and anything that a page would fetch
# from elsewhere end it.
docs: $(VENV)/.installed-dev
	$(BIN)/python -m docs.site

bench: $(VENV)/.installed
	$(BIN)/tailroad bench --memory-rollouts 10000

bench-against: $(VENV)/.installed-dev
	$(BIN)/python -m tests.bench.against --rev $(or $(REV),22f7276)

bench-camera: $(VENV)/.installed-dev
	OMP_NUM_THREADS=1 $(BIN)/python -m tests.bench.camera_speed
	OMP_NUM_THREADS=1 $(BIN)/python -m tests.bench.ego_placement --ego vision --rollouts 40

guides: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -m long tests/deploy/test_guides.py

faults: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -m long tests/service/remote/fleet
	$(BIN)/python -m pytest -m 'long or not long' tests/service/remote/fleet/test_readers.py tests/service/evaluation/store/test_claim.py \
	  tests/service/remote/test_outages.py
	$(BIN)/python -m tests.bench.store_faults --plays 10000 --page build/store-faults.md

# The wheel with everything it needs, from the package index: minutes.
wheel: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -m long tests/e2e/test_wheel.py

# Drivers who look, in 100,000 rollouts: minutes.
attentive: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -m long tests/service/studies/human

fuzz: $(VENV)/.installed-dev
	$(BIN)/python -m tests.fuzz.run --payloads 100000 --seed 1 --out build/fuzz

# Zenoh's own router from the crates registry, HTTP through it, and the client in Rust. It is for the tests: quick to build.
foreign-clients: $(VENV)/.installed-dev
	OPT_LEVEL=0 nice -n 15 deploy/examples/http-gateway/build build/foreign-clients 1 tcp
	$(BIN)/python -m pytest -m long tests/deploy/test_foreign_clients.py

bench-fleet: $(VENV)/.installed-dev
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.bench.fleet_scale overhead
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.bench.fleet_scale memory
	$(BIN)/python -m tests.bench.fleet_scale efficiency

# Every method on every problem with a known answer over 200 seeds: hours where no run is kept; goes on where it was
# interrupted.
calibration: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -m long tests/ce
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.bench.ce_calibration --keep
	$(BIN)/python -m tests.bench.ce_which_method
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.bench.path_calibration --keep

# Criticality measures against commonroad-crime and ad-rss, which want another protobuf: an environment of their own.
other-measures: $(VENV)/.installed-dev
	$(PYTHON) -m venv build/other-measures
	build/other-measures/bin/python -m pip install -q --disable-pip-version-check commonroad-crime==0.4.5 ad-rss==5.0.0
	TAILROAD_MEASURES_PYTHON=$(CURDIR)/build/other-measures/bin/python $(BIN)/python -m pytest -m long tests/service/analysis/criticality

# OpenTURNS and UQpy on the same problems. UQpy wants an older NumPy: an environment of its own, with what `ce` needs.
calibration-peers: $(VENV)/.installed-dev
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e '.[peers]'
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.bench.ce_calibration --method ot-ce ot-nais ot-subset --seeds 30 --seeds-large 0 --keep
	$(PYTHON) -m venv build/uqpy
	build/uqpy/bin/python -m pip install -q --disable-pip-version-check UQpy==4.2.1 msgspec
	OPENBLAS_NUM_THREADS=1 build/uqpy/bin/python -W ignore -m tests.bench.ce_calibration --method uqpy-subset --seeds 50 --seeds-large 0 --keep
	$(BIN)/python -m tests.bench.ce_which_method

# Everything in policies/weights, in this order: the ego drives among the drivers, the thresholds are theirs and its.
# Each step goes on where it was interrupted. DATA: the data pack, or tables of `tailroad data import`.
# WEIGHTS elsewhere: the ego and the thresholds are then those of the drivers that lie there, not of the shipped ones.
WEIGHTS ?= policies/weights
ELSEWHERE = $(filter-out policies/weights,$(WEIGHTS))
drivers: $(VENV)/.installed-dev
	@test -n "$(DATA)" || { echo "make drivers needs DATA=DIR: the data pack, or tables of 'tailroad data import'"; exit 2; }
	OMP_NUM_THREADS=1 $(BIN)/tailroad train drivers-bc --data $(DATA) --out $(WEIGHTS) --seed 1
	OMP_NUM_THREADS=1 $(BIN)/tailroad train drivers --data $(DATA) --out $(WEIGHTS) --seed 1
	OMP_NUM_THREADS=1 $(BIN)/tailroad train ego-lidar --data $(DATA) --out $(WEIGHTS) --seed 1 --name lidar-paper \
	  --demonstrator careful --swerving 0 --emergency 0 --scenario i80-paper-10s $(if $(ELSEWHERE),--drivers $(WEIGHTS)/drivers-gail.safetensors)
	OMP_NUM_THREADS=1 $(BIN)/tailroad train ego-lidar --data $(DATA) --out $(WEIGHTS) --seed 1
	$(BIN)/tailroad train thresholds --scenario i80-paper-10s --ego lidar-paper --ego idm --rollouts 100000 --splitting 20000 \
	  --seed 1 --out build/thresholds --card $(WEIGHTS)/drivers-gail.json $(if $(ELSEWHERE),--weights $(WEIGHTS))
	$(BIN)/tailroad drivers card --weights $(WEIGHTS)/drivers-gail.safetensors --data $(DATA) --out deploy/cards --seed 1

# A motorway in free flow from the user's own copy of a recording (DLR Highway Traffic: the zip, DOI 10.5281/zenodo.14012005):
# road and scenario a39, drivers trained on it, their realism card. All of it is made of the recording: mind its licence.
A39 ?= build/a39
a39: $(VENV)/.installed-dev
	@test -n "$(COPY)" || { echo "make a39 needs COPY=FILE: your copy of the recording"; exit 2; }
	$(BIN)/tailroad data import $(COPY) --out $(A39)/tables
	OMP_NUM_THREADS=1 $(BIN)/tailroad train drivers --data $(A39)/tables --out $(A39)/weights --seed 1 $(TRAIN)
	$(BIN)/tailroad data motorway $(A39)/tables --name a39 --weights weights/drivers-gail.safetensors --out $(A39)
	$(BIN)/tailroad drivers card --weights $(A39)/weights/drivers-gail.safetensors --data $(A39)/tables --out $(A39) --seed 1

# It learns in our own world among the drivers, from no recordings; goes on where it was interrupted.
ego-vision: $(VENV)/.installed-dev
	OMP_NUM_THREADS=1 $(BIN)/tailroad train ego-vision --out $(WEIGHTS) --seed 1 --name vision-paper \
	  --demonstrator careful --emergency 0 --scenario i80-paper-10s --weather-scenario i80-paper-data --check-drives 120

# The example ego in Rust (needs cargo), and rollouts driven by it: minutes.
example-ego: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -m long tests/deploy/test_rust_ego.py

# The Python code of the messages that egos on the network exchange.
schema: $(VENV)/.installed-dev
	$(BIN)/python -m grpc_tools.protoc -I. --python_out=. --pyi_out=. service/world/egos/ego.proto

# What the image installs, to the byte: every file's hash; its bill of materials; the page of licences. After any change of a
# dependency. No index is named in them.
pins: $(VENV)/.installed-dev
	$(BIN)/uv pip compile -q --no-config pyproject.toml --extra postgres -c constraints.txt --generate-hashes --no-header --no-annotate \
	  --python $(BIN)/python --python-platform x86_64-manylinux_2_28 -o deploy/container/requirements.txt
	$(BIN)/python -m docs.site.licences
	$(BIN)/python -m docs.site.bill_of_materials

format: $(VENV)/.installed-dev
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf $(VENV) build dist *.egg-info

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(None if v >= (3, 11) else "tailroad needs Python 3.11 or newer, not %d.%d; name one with make PYTHON=python3.12" % v[:2])'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e .
	@touch $@

$(VENV)/.installed-dev: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e '.[train,dev]'
	@touch $@ $(VENV)/.installed
