# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's bundle of weights: image encoder, research scene format, pipeline (docs/scene-input.md)."""
