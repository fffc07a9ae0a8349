"""How far a run on forces alone will be from its motion, told before it starts.

Two things put it off: the integrator's tolerance, and forces between the samples that are not those of
the motion, or rates that are not those of the poses. Both grow as the linearised dynamics say.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from compare.simulation.integration import Accuracy
from compare.simulation.linearisation import Linearisation
from compare.simulation.plan import Plan
from compare.simulation.trajectory import rotation_between
from sixsps.arrays import Array
from sixsps.dynamics import State, forward_dynamics
from sixsps.errors import SixspsError
from sixsps.rotation import quaternion_rates

# Samples whose deviations are worked out at a time.
_BLOCK = 200
_PARTS = 4
# Shorter than the steps of DOP853 on a smooth motion, which makes the expected errors rather too large [s].
_ERROR_STEP = 1e-3


@dataclass(frozen=True, eq=False)
class Forecast:
    """Deviation of the pose that is to be expected along a plan.

    Attributes:
        time: (k,) the plan's samples up to where the deviation is beyond bounds [s].
        deviation: (k,) distance and angle times the platform's size [m].
        mismatch: the largest that one step between samples adds to it [m].
    """

    time: Array
    deviation: Array
    mismatch: float

    def horizon(self, lost: float) -> float:
        """Returns how long the deviation stays below `lost` [m], or as long as the plan is [s]."""
        beyond = self.deviation > lost
        if not beyond.any():
            return float(self.time[-1] - self.time[0])
        k = max(int(np.argmax(beyond)), 1)
        logs, times = np.log(self.deviation[k - 1 : k + 1]), self.time[k - 1 : k + 1]
        return float(np.interp(np.log(lost), logs, times) - self.time[0])


def forecast(
    plan: Plan, linear: Linearisation, accuracy: Accuracy, lost: float, *, consistent: bool
) -> Forecast:
    """Returns the deviation of a run, up to where it is `lost` [m] or to the end.

    Args:
        plan: motion and forces, n samples.
        linear: linearisation along it.
        accuracy: of the integrator.
        lost: deviation that ends it [m].
        consistent: whether the rates are those of the poses; else their mismatch is told but not followed.
    """
    size = plan.mechanism.characteristic_length
    # The integrator's errors are taken for random, one within its tolerance every millisecond.
    tolerated = np.diag(_tolerated(plan, accuracy) ** 2)
    own_part, variance = np.zeros(12), tolerated
    found, mismatch = [_length(own_part, variance, size)], 0.0
    for first in range(0, len(plan.motion) - 1, _BLOCK):
        try:
            own = _own_deviations(plan, slice(first, first + _BLOCK + 1))
        except SixspsError:  # samples so far apart that a step ends beyond all numbers
            own, mismatch = np.zeros((min(_BLOCK, len(plan.motion) - 1 - first), 12)), np.inf
            if consistent:
                break
        mismatch = max(mismatch, float(np.linalg.norm(own[:, :6] * _scales(size), axis=1).max()))
        times = plan.motion.time[first : first + _BLOCK + 1]
        for passed, new, dt in zip(linear.transitions(times), own, np.diff(times), strict=True):
            own_part = passed @ own_part + (new if consistent else 0.0)
            variance = passed @ variance @ passed.T + dt / _ERROR_STEP * tolerated
            found.append(_length(own_part, variance, size))
            if found[-1] > lost:
                break
        if found[-1] > lost:
            break
    return Forecast(plan.motion.time[: len(found)], np.array(found), mismatch)


def _scales(size: float) -> Array:
    return np.repeat([1.0, size], 3)


def _length(own_part: Array, variance: Array, size: float) -> float:
    scales = _scales(size)
    worst = np.linalg.eigvalsh(scales[:, None] * variance[:6, :6] * scales)[-1]
    return float(np.linalg.norm(own_part[:6] * scales) + np.sqrt(worst))


def _tolerated(plan: Plan, accuracy: Accuracy) -> Array:
    """Returns (12,) the deviations that a step of the integrator may have."""
    position, speed, turning = (
        float(np.abs(values).max())
        for values in (plan.start.position, plan.start.velocity, plan.start.angular_velocity)
    )
    return accuracy.atol + accuracy.rtol * np.repeat([position, 1.0, speed, turning], 3)


def _own_deviations(plan: Plan, samples: slice) -> Array:
    """Returns (k, 12) how far each step of a run that starts on the plan ends off its next sample."""
    motion = plan.motion[samples]
    steps = np.diff(motion.time)[:, None]
    start = State.of(motion[:-1])
    y = np.hstack([start.position, start.quaternion, start.velocity, start.angular_velocity])

    def rates(part: float, y: Array) -> Array:
        planned = plan.at(motion.time[:-1] + part * steps[:, 0])
        state = State(y[:, :3], y[:, 3:7], y[:, 7:10], y[:, 10:])
        inputs = (planned.forces, planned.force, planned.moment)
        acceleration = forward_dynamics(plan.mechanism, state, *inputs)
        turning = quaternion_rates(state.quaternion, state.angular_velocity)
        return np.hstack([state.velocity, turning, acceleration])

    # Runge and Kutta's method of order 4, in parts: the forces ring between samples where they bend.
    h = 1 / _PARTS
    for part in h * np.arange(_PARTS):
        k1 = rates(part, y)
        k2 = rates(part + h / 2, y + h * steps / 2 * k1)
        k3 = rates(part + h / 2, y + h * steps / 2 * k2)
        k4 = rates(part + h, y + h * steps * k3)
        y = y + h * steps / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    end = State.of(motion[1:])
    turned = rotation_between(end.quaternion, y[:, 3:7])
    return np.hstack(
        [y[:, :3] - end.position, turned, y[:, 7:10] - end.velocity, y[:, 10:] - end.angular_velocity]
    )
