# SPDX-License-Identifier: GPL-3.0-or-later
# Blender without a window (the bpy module) with RenderFormer-V2, for processors: docs/farm.md 8.
FROM debian:bookworm-slim
ARG BPY=4.5.15
# The address of PyTorch's index of builds for processors, which are 3 GB smaller; the default one has those for CUDA.
ARG TORCH_INDEX=

RUN apt-get update \
    && apt-get install --yes --no-install-recommends python3 python3-venv \
        libgl1 libice6 libsm6 libx11-6 libxext6 libxfixes3 libxi6 libxkbcommon0 libxrender1 \
    && rm -rf /var/lib/apt/lists/*
COPY requirements.txt /opt/renderformer-v2/
RUN python3 -m venv /opt/venv \
    && grep -E '^(numpy|torch|safetensors|fast-simplification|embreex)==' /opt/renderformer-v2/requirements.txt > /tmp/wanted \
    && /opt/venv/bin/pip install --no-cache-dir ${TORCH_INDEX:+--extra-index-url "$TORCH_INDEX"} bpy==$BPY -r /tmp/wanted \
    && rm /tmp/wanted
COPY . /opt/renderformer-v2
RUN printf '#!/bin/sh\nPYTHONPATH=/opt/renderformer-v2 exec /opt/venv/bin/python -m tools.blender_command "$@"\n' \
        > /usr/local/bin/blender \
    && chmod 755 /usr/local/bin/blender \
    && useradd --create-home renderer
USER renderer
WORKDIR /home/renderer
ENTRYPOINT ["blender"]
