"""The states that everything goes over: the bundled sinusoids of wu2012."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from benchmarks.plan import MECHANISM, MOTION
from sixsps.kernels.signatures import FORCES
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.trajectories import bundled

_LONGEST = 10**6


@dataclass(frozen=True)
class States:
    """A mechanism and its motion.

    Attributes:
        samples: of the motion.
    """

    samples: int

    @cached_property
    def mechanism(self) -> Mechanism:
        """The bundled mechanism."""
        return Mechanism.load(MECHANISM)

    @cached_property
    def motion(self) -> Motion:
        """The bundled motion."""
        return bundled(MOTION, self.mechanism, self.samples)

    def spread(self, count: int) -> Motion:
        """Returns so many samples, evenly spread over the motion, with rotation matrices ready made."""
        chosen = self.motion[np.linspace(0, self.samples - 1, count).astype(np.intp)]
        chosen.rotation  # noqa: B018  made here, and not while something is timed
        return chosen


def long_motion(mechanism: Mechanism, samples: int) -> Motion:
    """Returns a motion of any length: the bundled one, of a million samples, again and again."""
    motion = bundled(MOTION, mechanism, min(samples, _LONGEST))
    if samples == len(motion):
        return motion
    index = np.arange(samples) % len(motion)
    return Motion(
        time=np.arange(samples, dtype=np.float64),
        **{name: getattr(motion, name)[index] for name in FORCES.arrays},
    )
