# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that has bounced between the token triangles: radiosity with visibility by rays.

Form factors between patches (Goral et al. 1984), and the light that arrives at a point (Reichert 1992, "A two-pass
radiosity method"), are estimated by rays. The direct light on the patches comes from the light prior. Light through
glass, where the prior does not reach, is found by the same rays.
"""
from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional as F

from ...progress import part
from ...scene import RenderScene
from ..direct.direct_light import LightPrior
from ..effort import FULL, Effort
from ..fresnel import schlick
from ..sampling import cosine_directions, ggx_directions, in_a_row, scattered
from .bright_patches import worth_by_power, worth_by_sight
from .caustics import caustics
from .final_gather import ABOVE, Interior, Surroundings
from .openness import Openness
from .patches import PATCHES, STEEP, patches

BOUNCES = 3       # between patches, before the last one at the point: together as many as Cycles' diffuse ones
GLOSSY_BOUNCES = 2  # beside these: more bring next to nothing
PATCH_RAYS = 64   # from each side of a patch
PATCH_AIMED = 32  # and so many more to what is bright
POINTS = 4        # of a patch, at which lamps light it and from which its rays start
SHADOW_RAYS = 1 << 19  # from all patches to lamps; fewer points where there are many lamps, but one at least
SKY_RAYS = 64     # from each side of a patch, that look for the sky
RAYS = 24         # from a point
AIMED = 12        # and so many more to what is bright
GLOSSY_RAYS = 16  # from a point, towards what it reflects
PHOTONS = 1 << 16  # from lamps to glass


class Radiosity:
    """Built from a normalised RenderScene and its LightPrior; the result is in the prior's radiance units."""

    def __init__(self, scene: RenderScene, prior: LightPrior, effort: Effort = FULL):
        device = prior.radiance.device
        lamps = prior.lamps()
        openness = Openness(prior.blocking, prior.blockers, device) if effort.walls else None
        found = patches(scene, lamps, effort.patches, openness)
        with part(0.0, 0.2):
            self.interior = Interior(scene, found, prior)
        count = min(max(SHADOW_RAYS // (2 * PATCHES * max(len(lamps.share), 1)), 1), effort.of(POINTS))
        # Of all fronts, then of all backs, as of all that follows; points of a patch are one after the other.
        x, n = (torch.cat(sides).flatten(0, 1).to(device) for sides in _both_sides(*found.points(count)))
        diffuse, metal, layer = found.albedo.repeat(2, 1).to(device).split(3, dim=1)
        of_layer = found.layer.repeat(2, 1).to(device).repeat_interleave(count, 0).unbind(1)
        with part(0.2, 0.4):
            arriving = prior.arriving(x, n, scattered(x, 2), effort.of(SKY_RAYS) // count)
        with part(0.4, 0.5):
            self.caustics, of_glass = caustics(scene, prior, self.interior, found.vector.norm(dim=-1).to(device),
                                               effort.of(PHOTONS))
        with part(0.5, 0.6):
            white, slanting = prior.diffuse(x + ABOVE * n, n, arriving, *of_layer).view(-1, count, 6).split(3, 2)
            light = (diffuse + STEEP * metal)[:, None] * white + layer[:, None] * slanting
        size = found.weight.repeat(2).to(device)
        self.interior.aim(worth_by_power(light.mean(1), size))
        with part(0.6, 1.0):
            start = scattered(x, 2)
            directions = cosine_directions(n, effort.of(PATCH_RAYS) // count, start)
            around = self.interior.look(x, n, directions, effort.of(PATCH_AIMED) // count, start)
            weight = self.interior.telling(around, count)
            around = around.together(weight)
        first, glossy = (weight[..., None] * light).mean(1), metal + layer
        through = (diffuse + glossy) * (around.through + of_glass)
        glossily, diffusely = self._bounced(around, first + through, diffuse, glossy)
        again = through + diffusely
        leaving = first + again + glossily
        self.interior.aim(worth_by_sight(leaving, size, around.side, around.share))
        self.leaving = torch.cat([leaving, again], dim=1)  # all, and what had bounced diffusely

    def _bounced(self, around: Surroundings, light: Tensor, diffuse: Tensor,
                 glossy: Tensor) -> tuple[Tensor, Tensor]:
        """What becomes of `light` (2 S, 3) that leaves the patches, by as many bounces as Cycles allows: (2 S, 3) each.

        By glossy bounces alone, which traced light follows from mirrors, and by others.
        """
        found = {(0, 0): light}  # what has bounced diffusely, and glossily, so often
        for count in range(1, BOUNCES + GLOSSY_BOUNCES + 1):
            pairs = [(d, count - d) for d in range(count + 1) if d <= BOUNCES and count - d <= GLOSSY_BOUNCES]
            before = [key for key in found if sum(key) == count - 1]
            arriving = dict(zip(before, around.gathered(torch.cat([found[k] for k in before], 1)).split(3, 1)))
            for d, g in pairs:
                found[d, g] = sum(lobe * arriving[key] for lobe, key in ((diffuse, (d - 1, g)), (glossy, (d, g - 1)))
                                  if key in arriving)
        return (sum(found[0, g] for g in range(1, GLOSSY_BOUNCES + 1)),
                sum(bounced for (d, _), bounced in found.items() if d))

    def __call__(self, position: Tensor, normal: Tensor, number: Tensor | None = None, effort: Effort = FULL,
                 alone: bool = False) -> Tensor:
        """Radiance leaving a white diffuse surface at points (P, 3) with unit normals (P, 3) -> (P, 9).

        Light that has bounced, the part of it that has done so diffusely before the last time, and the share of the
        sky's light that arrives; the first of these `alone` is (P, 3).
        number: (P,) of neighbours in a row, whose rays go between each other's; by default they are a row.
        """
        number = torch.arange(len(position), device=position.device) if number is None else number
        start = in_a_row(number)
        around = self.interior.look(position, normal, cosine_directions(normal, effort.of_probe(RAYS), start),
                                    effort.of_probe(AIMED), start)
        through = around.through + self.caustics(position, normal)
        if alone:
            return through + around.gathered(self.leaving[:, :3])
        bounced = F.pad(through, (0, 3)) + around.gathered(self.leaving)
        return torch.cat([bounced, around.sky_share(self.interior.environment)], dim=1)

    def glossy(self, position: Tensor, normal: Tensor, outgoing: Tensor, gloss: Tensor, number: Tensor,
               effort: Effort = FULL, traced: bool = False, direct: bool = True) -> Tensor:
        """Radiance leaving a white glossy surface at points (P, 3) towards `outgoing` (P, 3).

        (P, 3), or beside light that was `traced` (P, 6): what has bounced diffusely before, and as much of the rest as
        was not traced. Cycles follows so many paths from a surface as its glossy lobe has a share in each direction:
        it leaves out as much of that lobe's light as it traces of the diffuse one's, by the colours of both.
        With `direct` (P, 3) more, the share of the sky's light that arrives, as above.
        gloss: (P, 3), perceptual roughness, reflectance at normal incidence, and the diffuse lobe's share of the light
        over the glossy one's; number: (P,) as above.
        """
        start, (roughness, at_normal, matte) = in_a_row(number), gloss.unbind(1)
        direction, weight, cosine, density = ggx_directions(normal, outgoing, roughness, effort.of_probe(GLOSSY_RAYS),
                                                            start)
        around = self.interior.look(position, normal, direction, hazy=False)  # nobody asks for it here
        weight = weight * schlick(at_normal[:, None], cosine)
        weight = weight / weight.mean(1, keepdim=True).clamp_min(1e-6)
        if traced:
            diffusely = matte[:, None] * (direction @ normal[..., None])[..., 0].clamp_min(0) / math.pi
            missed = diffusely / (diffusely + weight * density).clamp_min(1e-6)
            once = self.leaving[:, :3] - self.leaving[:, 3:]
            found = [around.gathered(self.leaving[:, 3:], weight), around.gathered(once, weight * missed)]
        else:
            found = [around.gathered(self.leaving[:, :3], weight)]
        if direct:
            found.append(around.sky_share(self.interior.environment, weight))
        return torch.cat(found, dim=1)


def _both_sides(points: Tensor, normals: Tensor) -> tuple[tuple[Tensor, Tensor], tuple[Tensor, Tensor]]:
    return (points, points), (normals, -normals)
