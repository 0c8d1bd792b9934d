# SPDX-License-Identifier: GPL-3.0-or-later
"""How many camera rays Cycles sends through each pixel, and how many it has sent."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

RAYS = 8 * 512 * 512     # of a picture that has automatic samples: tracing takes about as long as the rest of a frame
AUTOMATIC = 8, 128       # samples, fewest and most
STEP = 16                # samples between two measurements of the noise; fixed in Cycles


class Sampling(NamedTuple):
    """The number of samples of a pixel. Cycles decides between `least` and `most` by the noise that it sees."""

    most: int
    threshold: float = 0.0  # noise at which a pixel has enough samples, of the exposed picture; 0: all have `most`
    least: int = 0          # 0: Cycles chooses it by the threshold

    @property
    def is_adaptive(self) -> bool:
        """Whether pixels may have different numbers: noise is looked at after every STEP samples."""
        return self.threshold > 0 and self.most > STEP

    @property
    def fixed(self) -> Sampling:
        """The same number for all pixels: where noise says nothing, or pictures are subtracted from each other."""
        return Sampling(self.most)

    def times(self, count: int) -> Sampling:
        """`count` times as many samples at most."""
        return self._replace(most=self.most * count)

    def divided(self, count: int) -> Sampling:
        """A share of the most samples, rounded up."""
        return self._replace(most=-(-self.most // count))

    def cycles_settings(self, exposure: float) -> dict[str, object]:
        """Settings of a session without exposure, for a picture with it: the noise that counts grows with its root."""
        return {"cycles.samples": self.most, "cycles.use_adaptive_sampling": self.is_adaptive,
                "cycles.adaptive_threshold": min(self.threshold / max(exposure, 1e-6) ** 0.5, 1.0),
                "cycles.adaptive_min_samples": self.least}

    def counts(self, share: np.ndarray | None) -> np.ndarray | int:
        """Samples that pixels have, as `share` (H, W): Cycles' pass Debug Sample Count, of the samples of the session.

        The session ends early where all pixels have enough; its length follows from the shares. Where these allow
        several, the shortest is taken, so that noise is not underestimated.
        """
        if share is None or not self.is_adaptive:
            return self.most
        values = np.unique(np.round(share[share > 0], 4))
        first_check = (self.least // STEP + (self.least % STEP == STEP - 1) + 1) * STEP
        for length in (*range(first_check, self.most, STEP), self.most):
            steps = values * length / STEP
            if (np.isclose(steps, np.round(steps), atol=2e-3) | (values == 1)).all():
                return share * length
        return self.most


def automatic_samples(width: int, height: int) -> int:
    """Samples of a pixel in a picture of this size."""
    return int(np.clip(round(RAYS / (width * height)), *AUTOMATIC))
