# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors that end a training, with one sentence that says what to do."""
from __future__ import annotations


class TrainingError(Exception):
    """The message names the file or setting and the remedy; the command line prints it without a traceback."""


class SampleError(TrainingError):
    """One file of samples cannot be read; the others may do."""
