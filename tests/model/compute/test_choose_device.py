# SPDX-License-Identifier: GPL-3.0-or-later
"""Which device is taken, and what is said about a card that is not; the cards are described, not there."""
from functools import partial

import pytest
import torch

from renderformer_v2.model.compute import devices, precision
from renderformer_v2.model.compute.devices import choose_device, explain_unused_card, is_built_for
from renderformer_v2.model.renderer import Renderer
from tests.described_cards import CUDA_13, describe


@pytest.fixture
def cards(monkeypatch):
    """Function that puts cards (name, capability, GiB) into the machine (described_cards.py)."""
    return partial(describe, monkeypatch)


@pytest.mark.parametrize("capability, expected", [
    ((6, 1), False), ((7, 0), False), ((7, 5), True), ((8, 9), True), ((9, 0), True), ((12, 1), True), ((13, 0), True)],
    ids=["Pascal", "Volta", "Turing", "Ada", "Hopper", "Blackwell", "later"])
def test_programs_for_cuda_13_run_from_turing_on(capability, expected):
    assert is_built_for(capability, CUDA_13) == expected


def test_programs_run_on_later_cards_of_their_generation_alone():
    assert is_built_for((8, 6), ["sm_80"]) and not is_built_for((9, 0), ["sm_80"])
    assert not is_built_for((8, 0), ["sm_86"])
    assert is_built_for((9, 0), ["sm_90a"]) and is_built_for((11, 0), ["gfx1100"])


def test_the_card_with_the_most_memory_is_taken_and_another_by_its_number(cards):
    cards(("Small", (8, 6), 8), ("Large", (8, 9), 24), ("Old", (6, 1), 48))
    assert choose_device() == torch.device("cuda", 1) and choose_device("cuda") == torch.device("cuda", 1)
    assert choose_device("cuda:0") == torch.device("cuda", 0)
    assert choose_device("cpu") == torch.device("cpu")
    with pytest.raises(ValueError, match="no GPU 4, only 3"):
        choose_device("cuda:3")


def test_a_card_that_is_too_old_for_the_build_is_named(cards):
    cards(("GeForce GTX 1080", (6, 1), 8))
    assert choose_device().type != "cuda"
    assert "GTX 1080 (compute capability 6.1)" in explain_unused_card() and "CUDA 12.6" in explain_unused_card()
    with pytest.raises(ValueError, match="GTX 1080.*Automatic or CPU"):
        choose_device("cuda")


def test_a_driver_that_is_too_old_is_said(cards):
    cards(driver=12040)
    assert "knows CUDA 12.4, and this PyTorch needs 13.0" in explain_unused_card()


@pytest.mark.parametrize("has_driver", [True, False])
def test_a_build_without_cuda_is_said_where_there_is_a_driver(cards, has_driver):
    cards(cuda=None, builds=[])
    assert ("build for the CPU" in explain_unused_card(has_driver)) == has_driver


def test_nothing_is_said_of_a_machine_without_card(cards):
    cards(driver=0)
    assert explain_unused_card() == ""


def test_a_format_that_fails_is_replaced_and_said(monkeypatch):
    monkeypatch.setattr(precision, "processor_precision", lambda _: torch.bfloat16)

    def linear(*arguments):
        raise RuntimeError("unknown parameter type\nmore")
    monkeypatch.setattr(precision.F, "linear", linear)
    made = Renderer(device="cpu")
    assert made.dtype == torch.float32 and "CPU" in made.computed_on and "Float32" in made.computed_on
    assert made.remark == "BFloat16 does not work in this PyTorch (unknown parameter type): Float32 is used"
    assert Renderer(device="cpu", precision="bf16").dtype == torch.bfloat16  # as it was chosen


def test_formats_that_work_are_kept():
    assert precision.find_failure(torch.float32, torch.device("cpu")) == ""
    assert precision.find_failure(torch.bfloat16, torch.device("cpu")) == ""
    assert devices.device_name(torch.device("cpu")).startswith("CPU")
