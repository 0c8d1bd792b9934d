# SPDX-License-Identifier: GPL-3.0-or-later
"""The golden numbers of the reference implementation: the small cases beside the tests, and all where they are."""
import json
import os
from pathlib import Path

import pytest
import torch

from tools.parity.__main__ import PSNR
from tools.parity.cases import Case
from tools.parity.compare import TOLERANCE, case_errors
from tools.parity.results import precision_psnr
from tools.parity.self_check import self_check

ROOT = Path(__file__).parents[2]
SMALL = ROOT / "tests" / "fixtures"
FULL = Path(os.environ.get("RF2_FIXTURES") or ROOT.parent / "shared" / "fixtures")
CASES = [SMALL / name for name in ("net_small_planar", "environment", "texture_tiles", "material")]
FULL_CASES = [FULL / name for name in ("net_small_main", "net_small_swin", "net_small_planar", "net_small_tiny",
                                       "environment", "texture_tiles", "material", "net_full_few")]
needs_all = pytest.mark.skipif(not FULL.is_dir(), reason="only the small fixtures are here (tests/fixtures/README.md)")


@pytest.mark.parametrize("path", [*CASES, *(pytest.param(path, marks=needs_all) for path in FULL_CASES)],
                         ids=lambda path: f"{path.parent.parent.name}-{path.name}")
def test_every_recorded_tensor_is_reproduced(path):
    case = Case.load(path.with_suffix(".json"))
    errors = dict(case_errors(case))
    recorded = {key for key in case.tensors if not key.startswith(("in.", "chk."))}
    assert recorded and recorded <= set(errors)
    assert {key: error for key, error in errors.items() if error > TOLERANCE} == {}


@needs_all
@pytest.mark.parametrize("exact_view", [False, True], ids=["on a processor", "on a card with TensorFloat-32"])
def test_bfloat16_keeps_the_picture(exact_view):
    assert precision_psnr(Case.load(FULL / "net_full_few.json"), torch.bfloat16, exact_view) > PSNR


def test_self_checks_of_the_specification():
    errors = dict(self_check(json.loads((SMALL / "selfcheck.json").read_text())))
    assert len(errors) > 30 and {key: error for key, error in errors.items() if error > TOLERANCE} == {}
