# Every target sets up .venv first (scripts/setup_venv.sh; seconds when nothing changed).
VENV ?= .venv
PY := $(VENV)/bin/python
JOBS ?= 1
export VENV

.PHONY: help setup demo demo-starts graph many-clips kills soak test faults check mutants fuzz lint bench accuracy animation paper tables clean

help:
	@echo "make demo         recover the bundled sample through fit_node; results in out/demo"
	@echo "make demo-starts  the same from start values that are 3x and 0.3x off, then the solver from 1.3x and 0.77x"
	@echo "make graph        the five nodes as five processes against one process, full length"
	@echo "make many-clips   a hundred tiny clips in a row through the five nodes; COUNT=n"
	@echo "make soak         clip after clip for half an hour, a node killed every three minutes: results, latency, memory; MINUTES=n"
	@echo "make kills        nodes killed and started again, each alone and in pairs, as a table; ONLY=\"fit_node fit_node+splat_node\""
	@echo "make test         all tests but those of make faults (JOBS=2 on two quiet cores: sixteen minutes, a minute more where Warp has compiled no kernel yet)"
	@echo "make faults       processes that are killed, starved or fed hostile input, and batches (JOBS=2: five minutes, in three processes)"
	@echo "make check        ruff, mypy and the quick tests: no nodes, no whole recovery or capture, no pretrained network, nothing of make faults, hardly anything over a second (a minute and a half on two cores)"
	@echo "make mutants      do the tests notice faults? ONLY=\"descent clamp\" for some, JOBS=n at a time, TABLE=file.md"
	@echo "make fuzz         hostile input for every door (under an hour on two cores); ONLY=\"settings bags\" for some, CASES=n each, SEED=n, JOBS=n at a time"
	@echo "make lint         ruff, mypy"
	@echo "make bench        speed of the simulator and the renderer"
	@echo "make accuracy     the simulator against beam theory and finite elements"
	@echo "make animation    recover both bundled clips and draw the moving pictures of the documents (six minutes on two cores)"
	@echo "make paper        the paper's tables and figures in out/paper (docs/paper.md); QUICK=1 for a look, DEVICE=cuda:0, ONLY=\"paper default\""
	@echo "make tables       rewrite the tables of the documents from the code and the stored rows"
	@echo "make clean        remove results, builds and .venv"

setup:
	@scripts/setup_venv.sh

demo: setup
	@$(PY) scripts/demo.py

demo-starts: setup
	@$(PY) scripts/demo_starts.py

graph: setup
	@$(PY) scripts/graph.py

many-clips: setup
	@$(PY) scripts/many_clips.py $(if $(COUNT),--count $(COUNT))

soak: setup
	@$(PY) scripts/soak.py $(if $(MINUTES),--minutes $(MINUTES))

kills: setup
	@$(PY) scripts/kills.py $(if $(ONLY),--nodes $(ONLY))

test: setup
	OMP_NUM_THREADS=1 OPENCV_FOR_THREADS_NUM=1 $(PY) -m pytest -m "not faults" $(if $(filter-out 1,$(JOBS)),-n $(JOBS) --dist loadfile)

faults: setup
	OMP_NUM_THREADS=1 OPENCV_FOR_THREADS_NUM=1 $(PY) -m pytest -m faults $(if $(filter-out 1,$(JOBS)),-n $$(($(JOBS) + 1)) --dist loadfile)

check: lint
	OMP_NUM_THREADS=1 OPENCV_FOR_THREADS_NUM=1 $(PY) -m pytest -q -m "not slow and not faults" -n auto --maxprocesses 4 --dist loadfile

mutants: setup
	$(PY) scripts/mutants.py --jobs $(JOBS) $(if $(TABLE),--table $(TABLE)) $(ONLY)

fuzz: setup
	OMP_NUM_THREADS=1 $(PY) scripts/fuzz.py --keep $(if $(filter-out 1,$(JOBS)),--jobs $(JOBS)) $(if $(CASES),--cases $(CASES)) $(if $(SEED),--seed $(SEED)) $(ONLY)

lint: setup
	$(PY) -m ruff check .
	$(PY) -m mypy diffphys_ros tools

bench: setup
	$(PY) benchmarks/substep.py
	$(PY) benchmarks/raster.py

accuracy: setup
	OMP_NUM_THREADS=1 PYTHONPATH=. $(PY) benchmarks/accuracy.py --figures docs/figures

animation: setup
	$(VENV)/bin/diffphys recover bags/sample_strip/clip.mcap --config bags/sample_strip/given.yaml --out out/animation/strip
	$(VENV)/bin/diffphys recover bags/sample/clip.mcap --config bags/sample/given.yaml --out out/animation/parts
	$(PY) scripts/animation.py out/animation/strip bags/sample_strip/clip.mcap --out docs/figures/animation.gif
	$(PY) scripts/animation.py out/animation/parts bags/sample/clip.mcap --out docs/figures/animation_parts.gif

paper: setup
	OMP_NUM_THREADS=1 $(PY) -m tools.paper $(if $(QUICK),--quick) $(if $(DEVICE),--device $(DEVICE)) $(if $(LPIPS),--lpips $(LPIPS)) $(if $(ONLY),--only $(ONLY))

tables: setup
	$(PY) scripts/readme_tables.py
	$(PY) benchmarks/notes.py
	$(PY) benchmarks/clips.py --tables

clean:
	rm -rf $(VENV) out build install log dist *.egg-info .pytest_cache .ruff_cache .mypy_cache
