"""When a simulation has to stop: legs at their limits, singular poses, states that are no numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from compare.simulation.legs import leg_states
from compare.simulation.plan import Plan, Stop
from sixsps.dynamics import State
from sixsps.mechanism import Mechanism
from sixsps.singularity import SINGULAR_CONDITION, condition_numbers

# Of a limit: what rounding may take a leg beyond it.
_SLACK = 1e-9
_BISECTIONS = 40


@dataclass(frozen=True, eq=False)
class Guard:
    """Bounds of a simulation: the leg lengths that the mechanism allows, and the side of singularities.

    Attributes:
        mechanism: what moves.
        side: sign of det J, which changes in a singularity.
    """

    mechanism: Mechanism
    side: float

    @classmethod
    def of(cls, plan: Plan) -> Guard:
        """Returns the bounds for simulations of a plan."""
        jacobian = leg_states(plan.mechanism, plan.start).jacobian[0]
        return cls(plan.mechanism, float(np.sign(np.linalg.det(jacobian))))

    def trouble(self, state: State) -> str:
        """Returns why a simulation has to stop at a state, n = 1; empty where it may go on."""
        legs = leg_states(self.mechanism, state)
        lengths, size = legs.lengths[0], self.mechanism.characteristic_length
        if not np.isfinite(lengths).all():
            return "the state is no number any more"
        shortest, longest = self.mechanism.length_limits.T
        outside = (lengths < shortest * (1 - _SLACK)) | (lengths > longest * (1 + _SLACK))
        if outside.any():
            leg = int(np.argmax(outside))
            allowed = f"{shortest[leg]:.6g} to {longest[leg]:.6g} m"
            return f"leg {leg + 1} leaves its limits: {lengths[leg]:.10g} m, allowed {allowed}"
        condition = float(condition_numbers(legs.jacobian, legs.lengths, size)[0])
        if condition > SINGULAR_CONDITION or np.sign(np.linalg.det(legs.jacobian[0])) != self.side:
            return "the pose becomes singular"
        return ""

    def first_trouble(self, start: float, end: float, at: Callable[[float], State]) -> Stop:
        """Returns the first trouble between two times, of which the second is one of trouble.

        Args:
            start: time without trouble [s].
            end: time of the end of a step [s].
            at: the state at a time between.
        """
        reason = self.trouble(at(end))
        for _ in range(_BISECTIONS):
            middle = (start + end) / 2
            found = self.trouble(at(middle))
            if found:
                end, reason = middle, found
            else:
                start = middle
        return Stop(reason, end)
