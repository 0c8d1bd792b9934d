# SPDX-License-Identifier: GPL-3.0-or-later
"""What ends a training run in one sentence that says what to do."""
from __future__ import annotations


class TrainingError(Exception):
    """The message names the file or setting and the remedy; the command line prints it without a traceback."""


class SampleError(TrainingError):
    """One file of samples cannot be read; the others may do."""
