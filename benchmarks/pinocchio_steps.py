"""The steps of the Pinocchio engine one by one: RNEA of the open tree, and the closed chain of one sample."""

from __future__ import annotations

from typing import Any

import pinocchio as pin

from compare.engines.pinocchio import Pinocchio, joint_rates
from sixsps.arrays import Array
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion


class PinocchioSteps(Pinocchio):
    """Keeps what the engine hands to RNEA along a motion.

    Args:
        mechanism: geometry and inertia.
        motion: n states.

    Attributes:
        states: (q, v, a, external wrenches) of each sample.
    """

    def __init__(self, mechanism: Mechanism, motion: Motion) -> None:
        super().__init__(mechanism)
        self.states: list[tuple[Array, Array, Array, Any]] = []
        self._keeping = True
        self.inverse_dynamics(motion, lambda _done: None)
        self._keeping = False
        self._rates = list(zip(*self.tree.platform_rates(motion), strict=True))

    def sample(self, q: Array, v: Array, a: Array, external: Any) -> Array:
        """Keeps a state; see `Pinocchio.sample`."""
        if self._keeping:
            self.states.append((q, v, a, pin.StdVec_Force(external)))
        return super().sample(q, v, a, external)

    def rnea_of_all(self) -> None:
        """Calls RNEA for every sample."""
        model, data, rnea = self.tree.model, self.tree.data, pin.rnea
        for q, v, a, external in self.states:
            rnea(model, data, q, v, a, external)

    def rnea(self, k: int) -> Array:
        """Returns the generalised forces (nv,) of the open tree at one sample."""
        return pin.rnea(self.tree.model, self.tree.data, *self.states[k])

    def closed_chain(self, k: int) -> Array:
        """Returns the (6,) leg forces of one sample from joint positions, and the platform's rates."""
        q, _, _, external = self.states[k]
        v, a = joint_rates(self.tree, q, *self._rates[k])
        return self.sample(q, v, a, external)[:6]
