# SPDX-License-Identifier: GPL-3.0-or-later
"""Choose the instances that get tokens, where not even their coarsest shapes all fit into Max Triangles.

Rays meet all instances of a part that keeps one. So each part keeps one if that is possible, and what shines takes
half of the room at most. Parts without room are joined (joining.py).
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..data.collected import Part
from ..data.copied import Instance
from ..data.report import SOME, Report
from ..meshes.reduce import COARSEST
from ..meshes.sampling import keep_sample
from .joining import join_parts

DETAIL = 0.6     # of the budget at most goes to the coarsest shapes of many instances
SHINING = 0.5    # of that goes to those that shine, at most
LEAST = 0.125    # ... at least
JOINED = 0.25    # of that goes to parts that are joined, if any are


def drop_instances(parts: list[Part], shares_of_picture: list[np.ndarray], targets, budget: int, report: Report):
    """Drop instances whose coarsest shape does not fit.

    Returns what remains of `parts`, `shares_of_picture` and `targets`.
    """
    if any(len(part.mesh) > COARSEST for part in parts):
        budget = int(DETAIL * budget)
    if sum(_least(part) * copies_of(part) for part in parts) <= budget:
        return parts, shares_of_picture, targets
    parts, shares_of_picture, targets = _merge_alike(parts, shares_of_picture, targets)
    keeps, growths = _choose(parts, shares_of_picture, budget)
    most = int(JOINED * budget) // COARSEST
    if most and any(map(_is_left_out, parts, keeps)):
        keeps, growths = _choose(parts, shares_of_picture, budget - most * COARSEST)
    left_out = [i for i in range(len(parts)) if _is_left_out(parts[i], keeps[i])]
    joined, lost = join_parts([parts[i] for i in left_out], most)
    remaining = _shared(joined, sum(shares_of_picture[i].sum() for i in left_out))
    crowd = _crowd(parts, keeps)
    for part, share, target, keep, growth in zip(parts, shares_of_picture, targets, keeps, growths, strict=True):
        if not keep.all() or (growth > 1).any():
            keep = _drop(part, share, keep, growth, crowd, report, any(part is other for other in lost))
        if part.instances:
            remaining.append((part, share[keep], target))
    return [list(column) for column in zip(*remaining)]


def _is_left_out(part: Part, keep: np.ndarray) -> bool:
    """Whether a part that does not shine keeps none of its instances."""
    return not part.emits and not keep.any()


def _shared(joined: list[Part], share: float) -> list[tuple[Part, np.ndarray, int]]:
    """Joined parts, with the shares of the picture that they have of `share`, by area, and targets."""
    area = sum(part.mesh.area for part in joined) + 1e-30
    return [(part, np.array([share * part.mesh.area / area + 1e-12]), len(part.mesh)) for part in joined]


def _choose(parts: list[Part], shares_of_picture: list[np.ndarray],
            budget: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """For each part (m,) bool, its instances whose coarsest shapes fit, and (m,) how much larger they are.

    Of those that shine a sample is kept, of others the most visible, but one of each part before any second one.
    """
    copies = list(map(copies_of, parts))
    cost = np.repeat(list(map(_least, parts)), copies)
    shines = np.repeat([part.emits for part in parts], copies)
    first = np.concatenate([np.arange(len(share)) == share.argmax() for share in shares_of_picture])
    fits, growth = ~shines, np.ones(len(cost))
    room = _room_for_emitters(cost, shines, first, budget)
    fits[shines], growth[shines] = _sample_emitters([part for part in parts if part.emits], first[shines], cost[shines],
                                                    room)
    order = np.lexsort((-np.concatenate(shares_of_picture), ~first, ~shines))
    order = order[fits[order]]
    fits[order] = np.cumsum(cost[order]) <= budget
    return tuple(np.split(values, np.cumsum(copies)[:-1]) for values in (fits, growth))


def _merge_alike(parts: list[Part], shares_of_picture: list[np.ndarray], targets):
    """The same with those that shine and are alike as one part: copies of a lamp often have meshes of their own."""
    alike: dict = {}
    for i, part in enumerate(parts):
        alike.setdefault(_key_without_instances(part) if part.emits else i, []).append(i)
    united = [replace(parts[rows[0]], instances=[instance for i in rows for instance in parts[i].instances])
              for rows in alike.values()]
    return (united, [np.concatenate([shares_of_picture[i] for i in rows]) for rows in alike.values()],
            [max(targets[i] for i in rows) for rows in alike.values()])


def _key_without_instances(part: Part) -> tuple:
    """The same for parts that differ in their instances alone."""
    return (part.mesh.digest, id(part.real), *map(id, part.materials), part.is_shown, part.flux_gain, part.hidden,
            part.lit_groups, part.blockers, part.instances[0].light_group)


def _room_for_emitters(cost: np.ndarray, shines: np.ndarray, first: np.ndarray, budget: int) -> float:
    """Triangles for what shines, of instances (m,) with these costs: SHINING of the budget, less where the `first` ones
    of the other parts need more than the rest."""
    return max(min(SHINING * budget, budget - cost[~shines & first].sum()), LEAST * budget)


def _sample_emitters(parts: list[Part], first: np.ndarray, cost: np.ndarray,
                     room: float) -> tuple[np.ndarray, np.ndarray]:
    """(m,) bool: a sample of the instances of parts that shine that fits into `room`, spread evenly, and (m,) how much
    larger these are, so that they give the light of all.

    first: (m,) bool, one of each part, which is kept where all of them fit: others may be as large and not as bright.
    cost: (m,) triangles. Radiance stays as it is, for rays that meet the real meshes read it.
    """
    if cost.sum() <= room:
        return np.ones(len(cost), bool), np.ones(len(cost))
    positions, scale = map(np.concatenate, zip(*map(middles_and_scales, parts), strict=True))
    area = np.repeat([part.mesh.area for part in parts], list(map(copies_of, parts))) * scale ** 2 + 1e-30
    if cost[first].sum() <= room / 2:
        area[first] = area.sum()
    most = max(room, cost.max()) - 0.4 * cost.max()  # the sample may have half an instance more
    keep, growth = keep_sample(area, most, cost=cost, positions=positions)
    sampled = growth > 1
    growth[sampled] *= np.sqrt(area[sampled].sum() / max((area * growth ** 2)[sampled & keep].sum(), 1e-30))
    return keep, np.where(keep, growth, 1)


def _crowd(parts: list[Part], keeps: list[np.ndarray]) -> str:
    """Names of what shines and has no room for all its instances; "" if there is none."""
    names = list(dict.fromkeys(part.name for part, keep in zip(parts, keeps, strict=True)
                               if part.emits and not keep.all()))
    return ", ".join(names[:SOME]) + (f" and {len(names) - SOME} more" if len(names) > SOME else "")


def _drop(part: Part, share: np.ndarray, keep: np.ndarray, growth: np.ndarray, crowd: str, report: Report,
          is_lost: bool) -> np.ndarray:
    """(m,) bool: the instances that a part keeps, about those in the mask `keep` (m,), enlarged by `growth` (m,).

    crowd: names of what shines and takes much of the room. is_lost: whether joined parts do without it as well.
    """
    some = "it exceeds" if len(keep) == 1 else f"{np.count_nonzero(~keep)} of its {len(keep)} instances exceed"
    room = f"{some} Max Triangles"
    real = part.matrices
    if part.emits and keep.any():
        _enlarge(part, growth)
        if not keep.all():
            report.approximated(part.name, f"{room}: the network gets a sample, enlarged to shine as much; raise it, "
                                           "or let fewer shine")
    elif keep.any() and len(part.mesh) <= COARSEST:  # as cards and leaves are
        keep = _sampled(part, share, np.count_nonzero(keep))
        report.approximated(part.name, f"{room}: the network gets a sample, enlarged to cover the same area")
    elif keep.any():
        report.approximated(part.name, f"{room}: the network gets the others alone")
    else:
        others = f", or let fewer instances of {crowd} shine, which take up to half of it" if crowd else ""
        if part.emits or is_lost:
            report.unplaced(part.name, f"{room}: raise it{others}")
        else:
            report.approximated(part.name, f"{room}: the network gets a sample of such things; raise it{others}")
    part.instances = _representing(part.instances, keep, real)
    return keep


def _representing(instances: list[Instance], keep: np.ndarray, real: list[np.ndarray]) -> list[Instance]:
    """The instances in the mask `keep` (m,), with the `real` matrices of themselves and of dropped ones after them."""
    representatives = np.flatnonzero(keep)
    if not len(representatives):
        return []
    owner = np.searchsorted(representatives, np.arange(len(keep)), side="right").clip(1) - 1
    return [replace(instances[row], real_matrices=tuple(real[i] for i in np.flatnonzero(owner == k)))
            for k, row in enumerate(representatives)]


def _sampled(part: Part, share: np.ndarray, count: int) -> np.ndarray:
    """(m,) bool: about `count` of its instances, at most, which are enlarged to the area of all."""
    positions, scale = middles_and_scales(part)
    low, high = part.mesh.bounds
    keep, growth = keep_sample(share, count - 0.4, positions=positions, sizes=scale * (high - low).max())
    _enlarge(part, np.where(keep, growth, 1))
    return keep


def _enlarge(part: Part, growth: np.ndarray) -> None:
    """Enlarge instances by factors (m,) around their middles."""
    middle = part.mesh.bounds.mean(axis=0)
    for i in np.flatnonzero(growth > 1):
        matrix = np.diag([growth[i]] * 3 + [1.0])
        matrix[:3, 3] = (1 - growth[i]) * middle
        part.instances[i] = replace(part.instances[i], matrix=part.instances[i].matrix @ matrix)


def middles_and_scales(part: Part) -> tuple[np.ndarray, np.ndarray]:
    """Places of its instances in the world (m, 3), and their scale compared with the mesh (m,)."""
    (low, high), matrix = part.mesh.bounds, np.array(part.matrices)
    scale = np.linalg.norm(matrix[:, :3, :3], axis=(1, 2)) / np.sqrt(3)
    return matrix[:, :3, :3] @ ((low + high) / 2) + matrix[:, :3, 3], scale


def _least(part: Part) -> int:
    """Triangles of its coarsest shape."""
    return min(len(part.mesh), COARSEST)


def copies_of(part: Part) -> int:
    """How many instances it has."""
    return len(part.instances)
