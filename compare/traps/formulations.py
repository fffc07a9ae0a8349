"""Traps that need no engine: the paper as printed, Euler rates, massless legs."""

from __future__ import annotations

from dataclasses import replace

from compare.engine import EngineForces, Progress
from compare.engines.formulation import FormulationEngine
from sixsps.bodies import Leg, Link
from sixsps.formulations.wu2012_printed import with_euler_rates
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

# As near to none as a mechanism admits: no digit of any force is left of it.
_NO_MASS = 1e-20


class _Formulation(FormulationEngine):
    """A formulation along a motion; subclasses say what is done to it first."""

    formulation = "Kane's method, Wu, Xiong & Kong (2012) corrected"
    loops = "none to close: leg motion in closed form"
    shares = "everything with kane but what makes it wrong"
    name = "kane"


class Wu2012Printed(_Formulation):
    """The paper's equations with all their misprints."""

    formulation = "Kane's method, Wu, Xiong & Kong (2012) as printed"
    shares = "leg kinematics and solve with kane"
    name = "wu2012-printed"


class EulerRates(_Formulation):
    """Rates of Euler angles where angular velocity and acceleration belong."""

    def inverse_dynamics(self, motion: Motion, progress: Progress) -> EngineForces:
        """Returns wrong leg forces along a motion."""
        return super().inverse_dynamics(with_euler_rates(motion), progress)


class MasslessLegs(_Formulation):
    """Only the platform has mass."""

    def __init__(self, mechanism: Mechanism) -> None:
        legs = tuple(
            Leg(_massless(leg.lower), _massless(leg.upper), leg.length_limits) for leg in mechanism.legs
        )
        super().__init__(replace(mechanism, legs=legs))


def _massless(link: Link) -> Link:
    return replace(
        link,
        mass=_NO_MASS * link.mass,
        transverse=_NO_MASS * link.transverse,
        axial=_NO_MASS * link.axial,
    )
