# SPDX-License-Identifier: GPL-3.0-or-later
"""Losses and gradients as CUDA graphs: a small network's thousands of operations take a card less time than the
processor takes to launch them one by one.

Everything behind the embedding of the scenes has shapes that only depend on the size of pictures and the length that
sequences are padded to, so there is one graph for each of these.
"""
from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields, replace

import torch
from torch import Tensor, nn

from renderformer_v2.model.tensor_group import TensorGroup

from .batch import Batch, each_field

TRIES = 3  # before a capture, in which libraries choose their algorithms


class CapturedLosses:
    """`compute(tokens, batch)` -> losses, with "total" as the last, replayed for embedded batches on a card.

    The gradients of `model` are set when the total is propagated back, and those of the tokens go on to the embedding.
    Sequences of other lengths than `lengths` are computed without a graph.
    """

    def __init__(self, model: nn.Module, compute: Callable[[Tensor, Batch], dict[str, Tensor]],
                 lengths: tuple[int, ...]):
        self.model, self.compute, self.lengths, self.graphs = model, compute, lengths, {}

    def __call__(self, tokens: Tensor, batch: Batch) -> dict[str, Tensor]:
        if batch.rows.shape[1] not in self.lengths:
            return self.compute(tokens, batch)
        batch = replace(batch, blocks=None, sample=replace(batch.sample, inputs=None))
        shapes = tuple(tensor.shape for tensor in tensors_of(batch))
        if shapes not in self.graphs:
            self.graphs[shapes] = Graph(self.model, self.compute, tokens, batch)
        graph = self.graphs[shapes]
        return dict(zip(graph.names, Replayed.apply(tokens, graph, batch).unbind(), strict=True))


class Graph:
    """One captured pass, forward and back, and the memory that it reads and writes."""

    def __init__(self, model: nn.Module, compute: Callable, tokens: Tensor, batch: Batch):
        self.tokens = tokens.detach().clone().requires_grad_()
        self.inputs = [tensor.clone() for tensor in tensors_of(batch)]
        static, before = rebuilt(batch, iter(self.inputs)), [(p, p.grad) for p in model.parameters()]

        def run() -> dict[str, Tensor]:
            for x in (self.tokens, *model.parameters()):
                x.grad = None
            # Casts that autocast caches would belong to the graph.
            with torch.autocast("cuda", torch.get_autocast_dtype("cuda"), torch.is_autocast_enabled("cuda"), False):
                losses = compute(self.tokens, static)
            losses["total"].backward()
            return {name: loss.detach() for name, loss in losses.items()}

        stream = torch.cuda.Stream()
        stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(stream):
            for _ in range(TRIES):
                run()
        torch.cuda.current_stream().wait_stream(stream)
        self.graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(self.graph, capture_error_mode="thread_local"):  # other threads pin batches meanwhile
            losses = run()
            self.losses = torch.stack(list(losses.values()))
        self.names, self.gradients = tuple(losses), [(p, p.grad) for p in model.parameters() if p.grad is not None]
        for p, gradient in before:
            p.grad = gradient

    def replay(self, tokens: Tensor, batch: Batch) -> Tensor:
        with torch.no_grad():
            torch._foreach_copy_([self.tokens, *self.inputs], [tokens, *tensors_of(batch)])
        self.graph.replay()
        return self.losses.clone()


class Replayed(torch.autograd.Function):
    """Tokens, a graph, a batch -> losses."""

    @staticmethod
    def forward(ctx, tokens: Tensor, graph: Graph, batch: Batch) -> Tensor:
        ctx.graph = graph
        return graph.replay(tokens, batch)

    @staticmethod
    def backward(ctx, grad: Tensor):
        scale, graph = grad[-1], ctx.graph  # of the total, which is all that is propagated
        scaled = torch._foreach_mul([gradient for _, gradient in graph.gradients], scale)
        for (p, _), gradient in zip(graph.gradients, scaled, strict=True):
            p.grad = gradient if p.grad is None else p.grad + gradient
        return graph.tokens.grad * scale, None, None


def tensors_of(group: TensorGroup) -> list[Tensor]:
    """All tensors of a group and of its inner ones."""
    values = [getattr(group, f.name) for f in fields(group)]
    return [tensor for value in values if value is not None
            for tensor in ([value] if isinstance(value, Tensor) else tensors_of(value))]


def rebuilt(group: TensorGroup, tensors: Iterator[Tensor]) -> TensorGroup:
    """The group with other tensors, in the order of `tensors_of`."""
    return each_field(group, lambda *_: next(tensors))
