"""`feedforward`: the whole motion with the computed forces, held on its way by a leg-length PD.

The forces are known every few milliseconds and interpolated, as a drive would do; what the PD has to
add measures how far the forces are from those that the motion needs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np

from compare.forward.engine import ForwardEngine
from compare.simulation.guard import Guard
from compare.simulation.integration import Accuracy, integrate
from compare.simulation.legs import leg_states
from compare.simulation.linearisation import Linearisation, spread
from compare.simulation.outcome import Outcome
from compare.simulation.plan import INTERPOLATION, Plan
from compare.simulation.trajectory import trajectory
from sixsps.arrays import Array
from sixsps.dynamics import State, mass_matrix
from sixsps.errors import InputError
from sixsps.singularity import condition_numbers

FORCE_STEP = 0.005
# Natural frequency of the platform's slowest mode on the PD, at least [rad/s], and over the rate at which
# the platform would fall without.
_FREQUENCY, _OVER_GROWTH = 2 * np.pi * 5, 2.0
# Near a singularity the legs see masses without bound, which no gains hold: poses of larger condition
# number do not count, and the lightest mode turns by this angle [rad] in `FORCE_STEP`, at most.
_SOFT_CONDITION, _MOST_TURN = 1e6, 10.0
# At a stage of a step a pose is off by the order of step^2, and the PD answers to that: tolerances near
# rounding would only make the steps short.
_RTOL, _ATOL = 1e-12, 1e-8


@dataclass(frozen=True)
class Gains:
    """A PD on each leg's length: stiffness [N/m] and damping [N s/m]."""

    stiffness: float
    damping: float

    @classmethod
    def of(cls, plan: Plan, stiffness: float | None = None, damping: float | None = None) -> Gains:
        """Returns the gains that were given, the others from the platform's mass seen by the legs.

        That mass, J^-T M J^-1 in coordinates of leg length, has six eigenvalues at every pose. On the
        stiffness the heaviest would swing at twice the rate at which the platform falls without, at
        5 Hz at least; with the damping the lightest is critically damped, and more would only make the
        run stiff. Poses close to a singularity are left out, and the lightest would swing at 2000 rad/s
        at most.

        Args:
            plan: motion.
            stiffness: [N/m].
            damping: [N s/m].
        """
        masses, conditions = _masses(plan)
        held = conditions <= max(_SOFT_CONDITION, conditions.min())
        lightest = float(masses[held].min())
        if stiffness is None:
            growth = Linearisation.along(plan).growth_rates[held]
            frequencies = np.maximum(_OVER_GROWTH * growth, _FREQUENCY)
            wanted = float((frequencies**2 * masses[held, -1]).max())
            stiffness = min(wanted, lightest * (_MOST_TURN / FORCE_STEP) ** 2)
        return cls(stiffness, 2 * float(np.sqrt(stiffness * lightest)) if damping is None else damping)


def _masses(plan: Plan) -> tuple[Array, Array]:
    """Returns where the motion is linearised the masses that the legs see, and the condition numbers.

    Returns:
        (k, 6) eigenvalues, rising [kg], and (k,) of the Jacobian.
    """
    motion, mechanism = plan.motion[spread(len(plan.motion))], plan.mechanism
    matrix = mass_matrix(mechanism, motion.position, motion.rotation)
    legs = leg_states(mechanism, State.of(motion))
    to_twist = np.linalg.inv(legs.jacobian)
    masses = np.linalg.eigvalsh(np.swapaxes(to_twist, 1, 2) @ matrix @ to_twist)
    return masses, condition_numbers(legs.jacobian, legs.lengths, mechanism.characteristic_length)


def feedforward(
    engine: ForwardEngine,
    plan: Plan,
    gains: Gains,
    progress: Callable[[int], None],
    force_step: float = FORCE_STEP,
) -> Outcome:
    """Returns the motion under the computed forces and the PD.

    Args:
        engine: forward dynamics of the plan's mechanism.
        plan: motion and forces.
        gains: of the PD.
        progress: called with the number of samples done so far.
        force_step: longest time between two known forces [s].

    Raises:
        InputError: the motion has fewer than four of them.
    """
    forces = _sampled_forces(plan, force_step)
    step = float(forces.x[1] - forces.x[0])

    def drive(t: float, y: Array) -> tuple[Array, Array, Array]:
        planned, legs = plan.at(t), leg_states(plan.mechanism, engine.platform(y))
        feedback = gains.stiffness * (planned.lengths - legs.lengths[0])
        feedback += gains.damping * (planned.rates - legs.rates[0])
        return forces(t) + feedback, planned.force, planned.moment

    accuracy = Accuracy(_RTOL, _ATOL * min(1.0, plan.mechanism.characteristic_length), step)
    coarse = float(np.diff(plan.motion.time).max())
    y, times = engine.initial(plan.start), plan.motion.time
    run = integrate(engine, y, times, drive, Guard.of(plan), accuracy, progress)
    return Outcome(
        trajectory(engine, plan, run.y, drive, feed_forward=forces(times[: len(run.y)])),
        stopped=run.stopped or plan.cut,
        settings={
            "integration": None if engine.steps_itself else accuracy.settings(),
            "forces": f"cubic spline, error of order 4, through forces every {step:g} s; those and the "
            f"reference of the PD from the {INTERPOLATION}",
            "force_step_s": step,
            "stiffness_N_m": gains.stiffness,
            "damping_N_s_m": gains.damping,
        },
        notes=(f"samples up to {coarse:g} s apart say less of the motion than forces every {step:g} s",)
        if coarse > step * (1 + 1e-9)
        else (),
    )


def _sampled_forces(plan: Plan, longest: float) -> Any:
    """Returns the spline through forces that are known at equal steps."""
    from scipy.interpolate import CubicSpline

    # Rounding must not add a step to a duration that is a whole number of them.
    steps = ceil(plan.duration / longest * (1 - 1e-9))
    if steps < 3:
        raise InputError("--force-step", longest, f"up to {plan.duration / 3:g} s, a third of the motion")
    times = np.linspace(plan.motion.time[0], plan.motion.time[-1], steps + 1)
    return CubicSpline(times, plan.at(times).forces)
