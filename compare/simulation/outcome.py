"""What every mode of simulation ends with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from compare.metrics import finite_or_none
from compare.simulation.plan import Stop
from compare.simulation.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Outcome:
    """A simulation that is done, or stopped.

    Attributes:
        trajectory: what came out, beside the plan.
        simulated: whether poses came out too, and not accelerations only.
        stopped: what ended it before its time; None where nothing did.
        settings: what the figures depend on.
        more: further entries of `simulation.json`.
        notes: what the user has to be told.
        inaccurate: why the figures are worse than they have to be; empty where they are not.
    """

    trajectory: Trajectory
    simulated: bool = True
    stopped: Stop | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    more: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    inaccurate: str = ""

    def measures(self, size: float) -> dict[str, Any]:
        """Returns the figures that every mode has a key for; None where it has no figure.

        Args:
            size: length that makes angular accelerations comparable [m].
        """
        path, poses = self.trajectory, self.simulated
        feedback = path.feedback
        found = {
            "max_acceleration_error": path.relative_acceleration_error(size),
            "max_position_error_m": float(path.position_error().max()) if poses else None,
            "max_orientation_error_rad": float(path.orientation_error().max()) if poses else None,
            "max_feedback_force_N": None if feedback is None else float(abs(feedback).max()),
            "growth_rate_per_s": None,
            "horizon_s": None,
            "max_closure_error_m": float(path.closure_error.max()),
        }
        found |= self.more
        # A run that diverged may have ended beyond all numbers, which JSON does not have.
        return {
            key: finite_or_none(value) if isinstance(value, float) else value for key, value in found.items()
        }
