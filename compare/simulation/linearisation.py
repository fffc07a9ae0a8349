"""The platform's dynamics linearised about a planned motion, leg forces given as functions of time.

Deviations are [delta p; delta theta; delta v; delta omega], world axes, R = exp(delta theta) R_planned:
delta p' = delta v, delta theta' = omega x delta theta + delta omega, and the accelerations by central
differences of the forward dynamics in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from compare.simulation.legs import leg_states
from compare.simulation.plan import Plan
from sixsps.arrays import Array
from sixsps.dynamics import State, forward_dynamics
from sixsps.mechanism import Mechanism
from sixsps.rotation import skew

# Cube root of unit roundoff, what central differences want, of the shortest leg.
_STEP = 6e-6
_POSES = 41


@dataclass(frozen=True, eq=False)
class Linearisation:
    """The linearised dynamics at k times along a motion.

    Attributes:
        time: (k,) [s].
        matrices: (k, 12, 12) A of deviation' = A deviation.
    """

    time: Array
    matrices: Array

    @classmethod
    def along(cls, plan: Plan) -> Linearisation:
        """Returns the linearisation at up to 41 samples, spread over the motion."""
        samples = spread(len(plan.motion))
        motion = plan.motion[samples]
        inputs = (plan.forces[samples], motion.force, motion.moment)
        return cls(motion.time, system_matrices(plan.mechanism, State.of(motion), *inputs))

    @cached_property
    def eigenvalues(self) -> NDArray[np.complex128]:
        """(k, 12) by falling real part [1/s]."""
        values = np.linalg.eigvals(self.matrices).astype(np.complex128)
        order = np.lexsort((-values.imag, -values.real), axis=-1)
        return np.take_along_axis(values, order, axis=-1)

    @property
    def growth_rates(self) -> Array:
        """(k,) largest real part of the eigenvalues [1/s]."""
        return self.eigenvalues[:, 0].real

    def most_unstable(self) -> Array:
        """Returns the first time's direction (12,) that grows fastest, its largest entry 1."""
        values, vectors = np.linalg.eig(self.matrices[0])
        direction = vectors[:, np.argmax(values.real)].real
        return np.asarray(direction / np.abs(direction).max())

    def growth(self) -> Array:
        """Returns (k,) the logarithm of what a deviation has grown by since the first time."""
        rate = np.maximum(self.growth_rates, 0.0)
        steps = np.diff(self.time) * (rate[1:] + rate[:-1]) / 2
        return np.concatenate([[0.0], np.cumsum(steps)])

    def largest_rate(self, end: float) -> float:
        """Returns the largest growth rate from the first time to `end` [1/s]."""
        inside = self.growth_rates[self.time <= end]
        return float(max(inside.max(), np.interp(end, self.time, self.growth_rates)))

    def transitions(self, time: Array) -> Array:
        """Returns (n - 1, 12, 12) what deviations at each of n times become up to the next."""
        from scipy.interpolate import make_interp_spline
        from scipy.linalg import expm

        if len(self.time) < 2:
            matrices = np.repeat(self.matrices, len(time) - 1, axis=0)
        else:
            matrices = make_interp_spline(self.time, self.matrices, k=1)((time[1:] + time[:-1]) / 2)
        return np.asarray(expm(matrices * np.diff(time)[:, None, None]))

    def mean_rate(self, end: float) -> float:
        """Returns the mean growth rate from the first time to `end` [1/s]."""
        elapsed = end - self.time[0]
        return float(np.interp(end, self.time, self.growth()) / elapsed)

    def time_to_grow(self, factor: float) -> float:
        """Returns how long a deviation takes to grow by a factor, or infinity: not in this motion [s]."""
        growth, wanted = self.growth(), float(np.log(factor))
        if growth[-1] < wanted:
            return np.inf
        return float(np.interp(wanted, growth, self.time) - self.time[0])


def spread(n: int) -> NDArray[np.intp]:
    """Returns up to 41 of n samples, the first and the last among them."""
    return np.unique(np.linspace(0, n - 1, min(n, _POSES)).astype(np.intp))


def system_matrices(mechanism: Mechanism, state: State, forces: Array, force: Array, moment: Array) -> Array:
    """Returns A (n, 12, 12) of deviation' = A deviation at n states.

    Args:
        mechanism: geometry and inertia.
        state: n states.
        forces: (n, 6) leg forces [N].
        force: (n, 3) external force on the platform's centre of mass [N].
        moment: (n, 3) external moment [N m].
    """
    n = len(state)
    leg = float(leg_states(mechanism, state).lengths.min())
    # Accelerations are quadratic in the velocities: for those, central differences are exact.
    steps = np.repeat([_STEP * leg, _STEP * min(1.0, leg / mechanism.characteristic_length), leg, 1.0], 3)
    deviations = np.concatenate([np.diag(steps), -np.diag(steps)])
    moved = deviated(state, np.tile(deviations, (n, 1)))
    inputs = (np.repeat(given, 24, axis=0) for given in (forces, force, moment))
    accelerations = forward_dynamics(mechanism, moved, *inputs).reshape(n, 2, 12, 6)
    slopes = (accelerations[:, 0] - accelerations[:, 1]) / (2 * steps[:, None])
    matrices = np.zeros((n, 12, 12))
    matrices[:, :6, 6:] = np.eye(6)
    matrices[:, 3:6, 3:6] = skew(state.angular_velocity)
    matrices[:, 6:] = np.swapaxes(slopes, 1, 2)
    return matrices


def deviated(state: State, deviations: Array) -> State:
    """Returns states moved by deviations, m of them for each state in turn.

    Args:
        state: n states.
        deviations: (n m, 12).
    """
    from scipy.spatial.transform import Rotation

    each = len(deviations) // len(state)
    position, quaternion, velocity, angular = (
        np.repeat(getattr(state, name), each, axis=0)
        for name in ("position", "quaternion", "velocity", "angular_velocity")
    )
    turned = Rotation.from_rotvec(deviations[:, 3:6]) * Rotation.from_quat(quaternion, scalar_first=True)
    return State(
        position + deviations[:, :3],
        turned.as_quat(scalar_first=True),
        velocity + deviations[:, 6:9],
        angular + deviations[:, 9:],
    )
