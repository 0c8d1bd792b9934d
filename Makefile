# SPDX-License-Identifier: GPL-3.0-or-later
# make render    render an example through the engine       make test    run the tests       make lint    check the style
# make slow      run the tests that take minutes         make window  run sessions in the window of RENDERFORMER_V2_BLENDER
# BPY=5.0.1 make test    the same with another Blender, in a virtual environment of its own
# BPY=5.2.3 PYTHON=python3.13 make test    Blender is made for Python 3.13 from 5.1 on
FIRST := 4.5.15
BPY ?= $(FIRST)
# What needs another Python than the first Blender.
OTHER := $(filter-out 4.% 5.0.%,$(BPY))
PYTHON ?= python3.$(if $(OTHER),13,11)
# .venv holds every package and the first Blender; the environment of another version holds that Blender, and finds the
# other packages there, if they are made for its Python. Both are seen from their own lib/python3.11/site-packages.
SHARED := ../../../../.venv/lib/python3.11/site-packages
VENV := .venv$(if $(filter-out $(FIRST),$(BPY)),-$(BPY))
RUN := $(VENV)/bin/python
READY := $(VENV)/.ready-$(BPY)
# pip compiles what it installs, even where PYTHONDONTWRITEBYTECODE is set: there each process would otherwise compile
# PyTorch's Python anew, which takes seconds.
PIP := -m pip install --quiet --disable-pip-version-check --compile
OUT := examples/out
# What needs no Blender is tested once with each Python, and the tools with the first and the last Blender.
REST := $(if $(filter-out $(FIRST) $(OTHER),$(BPY)),--ignore tests/model --ignore tests/tools)

.PHONY: render test slow window lint extension clean
.DELETE_ON_ERROR:

render: $(OUT)/room.blend
	$(RUN) -m tools.render $< -o $(OUT)/room.exr -o $(OUT)/room.png

test: $(READY)
	$(RUN) -m pytest -n auto --dist worksteal $(REST)

slow: $(READY)
	$(RUN) -m pytest -n auto --dist worksteal -m slow

window: $(READY)
	$(RUN) -m pytest -m slow tests/window --basetemp $(OUT)/window

lint: .venv/.ready-$(FIRST)
	.venv/bin/python -m ruff check

extension: $(READY)
	$(RUN) -m tools.build --without-wheels

$(OUT)/room.blend: examples/room.py | $(READY)
	mkdir -p $(OUT)
	$(RUN) $< $@

.venv/.ready-$(FIRST): requirements.txt
	test -x .venv/bin/python || $(PYTHON) -m venv .venv
	.venv/bin/python $(PIP) bpy==$(FIRST) -r requirements.txt
	touch $@

.venv-$(BPY)/.ready-$(BPY): $(if $(OTHER),requirements.txt,.venv/.ready-$(FIRST))
	test -x .venv-$(BPY)/bin/python || $(PYTHON) -m venv .venv-$(BPY)
	$(if $(OTHER),,echo $(SHARED) > .venv-$(BPY)/lib/python3.11/site-packages/shared.pth)
	.venv-$(BPY)/bin/python $(PIP) bpy==$(BPY) $(if $(OTHER),-r requirements.txt)
	touch $@

clean:
	rm -rf build $(OUT)
