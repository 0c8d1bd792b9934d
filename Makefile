# SPDX-License-Identifier: GPL-3.0-or-later
# make render    render an example through the engine       make test    run the tests
# BPY=5.0.1 make test    the same with another Blender, in a virtual environment of its own
PYTHON ?= python3.11
BPY ?= 4.5.15
VENV := .venv$(if $(filter-out 4.5.15,$(BPY)),-$(BPY))
RUN := $(VENV)/bin/python
READY := $(VENV)/.ready-$(BPY)
OUT := examples/out

.PHONY: render test extension clean
.DELETE_ON_ERROR:

render: $(OUT)/room.blend
	$(RUN) -m tools.render $< -o $(OUT)/room.exr -o $(OUT)/room.png

test: $(READY)
	$(RUN) -m pytest

extension: $(READY)
	$(RUN) -m tools.build

$(OUT)/room.blend: examples/room.py | $(READY)
	mkdir -p $(OUT)
	$(RUN) $< $@

$(READY): requirements.txt
	test -x $(RUN) || $(PYTHON) -m venv $(VENV)
	$(RUN) -m pip install --quiet --disable-pip-version-check bpy==$(BPY) -r requirements.txt
	touch $@

clean:
	rm -rf build $(OUT)
