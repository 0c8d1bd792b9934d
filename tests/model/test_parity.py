# SPDX-License-Identifier: GPL-3.0-or-later
"""The golden numbers of the reference implementation."""
import json
from pathlib import Path

import pytest
import torch

from tools.parity.__main__ import PSNR
from tools.parity.cases import Case
from tools.parity.compare import TOLERANCE, case_errors
from tools.parity.results import precision_psnr
from tools.parity.self_check import self_check

FIXTURES = Path(__file__).parents[3] / "shared" / "fixtures"
CASES = ["net_small_main", "net_small_swin", "net_small_planar", "net_small_tiny", "environment", "texture_tiles",
         "material", "net_full_few"]

pytestmark = pytest.mark.skipif(not FIXTURES.is_dir(), reason="the golden fixtures are not part of the repository")


@pytest.mark.parametrize("name", CASES)
def test_every_recorded_tensor_is_reproduced(name):
    errors = dict(case_errors(Case.load(FIXTURES / f"{name}.json")))
    recorded = [key for key in Case.load(FIXTURES / f"{name}.json").tensors if not key.startswith(("in.", "chk."))]
    assert set(recorded) <= set(errors)
    assert {key: error for key, error in errors.items() if error > TOLERANCE} == {}


def test_bfloat16_keeps_the_picture():
    assert precision_psnr(Case.load(FIXTURES / "net_full_few.json"), torch.bfloat16) > PSNR


def test_self_checks_of_the_specification():
    errors = dict(self_check(json.loads((FIXTURES / "selfcheck.json").read_text())))
    assert len(errors) > 30 and {key: error for key, error in errors.items() if error > TOLERANCE} == {}
