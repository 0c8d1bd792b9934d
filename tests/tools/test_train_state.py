# SPDX-License-Identifier: GPL-3.0-or-later
"""The state of a run survives bad gradients, damaged files and a kill, and goes on exactly."""
import pytest
import torch
from torch import nn

from tools.train.errors import TrainingError
from tools.train.state import MOST_SKIPPED, TrainingState, backup


class TwoPaths(nn.Module):
    """As in a network some of whose inputs are not in every scene."""

    def __init__(self, width: int = 3):
        super().__init__()
        torch.manual_seed(0)
        self.always, self.sometimes = nn.Linear(width, width), nn.Linear(width, width)


def new_state(width: int = 3) -> TrainingState:
    return TrainingState(TwoPaths(width), 0.1, 0.01, 0.9)


def step(state: TrainingState, factor: float = 1.0) -> bool:
    x = torch.linspace(0, 1, 3)
    y = state.model.always(x)
    if state.step % 3 == 1:
        y = state.model.sometimes(y)
    (y.square().sum() * factor).backward()
    return state.advance(0.1, clip_norm=1.0)


def values(state: TrainingState) -> list[torch.Tensor]:
    return [x.clone() for x in (*state.model.parameters(), *state.average.values())]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "state.safetensors"


def trained(path, steps: int) -> TrainingState:
    """A state saved after the last two of its steps."""
    state = new_state()
    for i in range(steps):
        step(state)
        if i >= steps - 2:
            state.save(path)
    return state


def test_a_resumed_run_takes_the_very_same_steps(path):
    state, resumed = trained(path, 5), new_state()
    assert resumed.resume(path) and resumed.step == 5
    for _ in range(4):
        step(state), step(resumed)
    for a, b in zip(values(state), values(resumed), strict=True):
        torch.testing.assert_close(a, b, rtol=0, atol=0)


def test_gradients_that_are_not_finite_change_nothing_and_end_the_run_when_they_go_on():
    state = new_state()
    step(state)
    before = values(state)
    for _ in range(MOST_SKIPPED - 1):
        assert not step(state, float("nan"))
    assert state.step == 1 and state.skipped == MOST_SKIPPED - 1
    for a, b in zip(before, values(state), strict=True):
        torch.testing.assert_close(a, b, rtol=0, atol=0)
    assert step(state)
    with pytest.raises(TrainingError, match="not finite: lower learning_rate"):
        for _ in range(MOST_SKIPPED):
            step(state, float("inf"))


def test_a_state_that_is_not_finite_never_replaces_a_good_one(path):
    state = trained(path, 3)
    good = path.read_bytes()
    with torch.no_grad():
        state.model.always.weight[0, 0] = float("nan")
    with pytest.raises(TrainingError, match="always.weight is no longer finite at step 3"):
        state.save(path)
    assert path.read_bytes() == good


@pytest.mark.parametrize("content", [b"", b"damaged", "half", "nan", None])
def test_a_damaged_or_lost_state_is_replaced_by_the_one_before(path, content):
    trained(path, 4)
    if content is None:  # killed between two renames
        path.unlink()
    elif content == "nan":
        nonsense = path.read_bytes()
        path.write_bytes(nonsense[:-4] + b"\xff\xff\xff\x7f")
    else:
        path.write_bytes(path.read_bytes()[:-9] if content == "half" else content)
    resumed = new_state()
    assert resumed.resume(path) and resumed.step == 3
    step(resumed)
    resumed.save(path)
    again = new_state()
    assert again.resume(path) and again.step == 4
    path.write_bytes(b"")
    assert again.resume(path) and again.step in (3, 4), "a damaged file has replaced the backup"


def test_nothing_is_started_anew_over_files_that_cannot_be_read(path):
    assert not new_state().resume(path)
    trained(path, 4)
    for file in (path, backup(path)):
        file.write_bytes(b"damaged")
    with pytest.raises(TrainingError, match="restore one of them"):
        new_state().resume(path)


def test_the_state_of_another_network_is_not_taken_for_a_damaged_one(path):
    trained(path, 4)
    with pytest.raises(TrainingError, match="another network"):
        new_state(width=4).resume(path)
    assert path.is_file()
