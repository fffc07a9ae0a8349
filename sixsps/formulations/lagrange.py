"""Lagrange's equations from two energies that are functions of positions, in CasADi.

Coordinates are q = [P; theta]: the platform turns to R(theta) R0 from the sample's rotation R0, with

    R(theta) = (E - [theta/2]x)^-1 (E + [theta/2]x)    (Cayley)

Its angular velocity is (theta' + theta x theta'/2) / (1 + |theta|^2/4), so that at theta = 0, where
everything is evaluated, theta' = omega and theta'' = epsilon, and q' is the twist. What is written
down is where lengths, centres of mass, leg directions and R are; rates, both kinds of derivatives in

    J F = d/dt (dT/dq') - dT/dq + dV/dq - Q_load,    J = (d lengths / dq)^T

and J itself come by algorithmic differentiation. A rigid body enters its kinetic energy by the second
moments of its mass, so that no angular velocity and no inertia tensor is turned anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from sixsps.arrays import Array
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.singularity import SINGULAR_CONDITION, condition_numbers

# Rows and columns of what the equations are given; `lower` and `upper` hold mass, com, transverse.
_SAMPLE = {
    "position": (3, 1),
    "rotation": (3, 3),
    "twist": (6, 1),
    "acceleration": (6, 1),
    "force": (3, 1),
    "moment": (3, 1),
}
_MECHANISM = {
    "gravity": (3, 1),
    "base_anchors": (3, 6),
    "platform_anchors": (3, 6),
    "mass": (1, 1),
    "com": (3, 1),
    "second_moments": (3, 3),
    "lower": (3, 6),
    "upper": (3, 6),
}
_Weighted = list[tuple[ca.SX, ca.SX]]


def inverse_dynamics(mechanism: Mechanism, motion: Motion) -> Array:
    """Returns the leg forces along a motion.

    Args:
        mechanism: geometry and inertia.
        motion: n samples.

    Returns:
        (n, 6) leg forces [N], positive in extension; NaN at singular poses.
    """
    forces = np.full((len(motion), 6), np.nan)
    if len(motion) == 0:
        return forces
    J, C, lengths = evaluate(equations(), mechanism, motion)
    size = mechanism.characteristic_length
    regular = condition_numbers(J.swapaxes(1, 2), lengths[..., 0], size) <= SINGULAR_CONDITION
    scale = np.array([1.0] * 3 + [size] * 3)[:, None]
    Q, R = np.linalg.qr(J[regular] / scale)
    # R is triangular: elimination finds nothing to eliminate, and substitutes back.
    forces[regular] = np.linalg.solve(R, Q.swapaxes(1, 2) @ (C[regular] / scale))[..., 0]
    return forces


def turned_by(theta: ca.SX) -> ca.SX:
    """Returns the rotation matrix (E - [theta/2]x)^-1 (E + [theta/2]x), multiplied out."""
    cross = ca.skew(theta)
    return ca.SX.eye(3) + (cross + cross @ cross / 2) / (1 + ca.sumsqr(theta) / 4)


@lru_cache(maxsize=1)
def equations() -> ca.Function:
    """Returns the function (sample, mechanism) -> J (6, 6), C (6,) of J F = C, lengths (6,)."""
    system = _system()
    q, dq, ddq = system.q, system.given["twist"], system.given["acceleration"]
    momentum = ca.gradient(system.kinetic, dq)
    momentum_rate = ca.jtimes(momentum, ca.vertcat(q, dq), ca.vertcat(dq, ddq))
    slope = ca.gradient(system.potential - system.kinetic, q)
    load = ca.gradient(system.load_power, dq)
    J = ca.jacobian(system.lengths, q).T
    outputs = {"J": J, "C": momentum_rate + slope - load, "lengths": system.lengths}
    return system.function("lagrange", outputs)


@lru_cache(maxsize=1)
def energy() -> ca.Function:
    """Returns the function (sample, mechanism) -> kinetic, potential energy [J]."""
    system = _system()
    return system.function("energy", {"kinetic": system.kinetic, "potential": system.potential})


def evaluate(function: ca.Function, mechanism: Mechanism, motion: Motion) -> list[Array]:
    """Evaluates one of this module's functions at every sample of a motion, in a single call.

    Args:
        function: `equations()` or `energy()`.
        mechanism: gives its parameters.
        motion: n > 0 samples.

    Returns:
        (n, rows, columns) values of each output.
    """
    results = function.call([*_sample(motion), *_parameters(mechanism)])
    values = []
    for index, result in enumerate(results):
        rows, columns = function.size_out(index)
        values.append(np.asarray(result.full()).reshape(rows, len(motion), columns).swapaxes(0, 1))
    return values


def _sample(motion: Motion) -> list[ca.DM]:
    """Returns the samples side by side, which CasADi takes for as many calls."""
    columns = {
        "position": motion.position.T,
        "rotation": motion.rotation.swapaxes(0, 1).reshape(3, -1),
        "twist": np.hstack([motion.velocity, motion.angular_velocity]).T,
        "acceleration": np.hstack([motion.acceleration, motion.angular_acceleration]).T,
        "force": motion.force.T,
        "moment": motion.moment.T,
    }
    return [ca.DM(columns[name]) for name in _SAMPLE]


def _parameters(mechanism: Mechanism) -> list[ca.DM]:
    platform, lower, upper = mechanism.platform, mechanism.lower, mechanism.upper
    values = {
        "gravity": mechanism.gravity,
        "base_anchors": mechanism.base_anchors.T,
        "platform_anchors": mechanism.platform_anchors.T,
        "mass": platform.mass,
        "com": platform.com,
        # Integral of x x^T dm about the centre of mass, whose trace is half that of the inertia.
        "second_moments": np.trace(platform.inertia) / 2 * np.eye(3) - platform.inertia,
        "lower": np.array([lower.mass, lower.com, lower.transverse]),
        "upper": np.array([upper.mass, upper.com, upper.transverse]),
    }
    return [ca.DM(values[name]) for name in _MECHANISM]


@dataclass(frozen=True, eq=False)
class _System:
    """The mechanism as functions of q and q', in the symbols of `given`.

    Attributes:
        given: name -> symbol of each input; the twist is q', the acceleration q''.
        q: (6,) coordinates, the position and theta.
        lengths: (6,) of the legs.
        kinetic: kinetic energy T.
        potential: potential energy V of gravity.
        load_power: power of the external wrench, whose slope along q' is its generalised force.
    """

    given: dict[str, ca.SX]
    q: ca.SX
    lengths: ca.SX
    kinetic: ca.SX
    potential: ca.SX
    load_power: ca.SX

    def function(self, name: str, outputs: dict[str, ca.SX]) -> ca.Function:
        """Returns a function of all inputs, at theta = 0."""
        values = ca.substitute(list(outputs.values()), [self.q[3:]], [ca.SX.zeros(3)])
        return ca.Function(name, list(self.given.values()), ca.cse(values), list(self.given), list(outputs))


@lru_cache(maxsize=1)
def _system() -> _System:
    given = {name: ca.SX.sym(name, *shape) for name, shape in (_SAMPLE | _MECHANISM).items()}
    theta = ca.SX.sym("theta", 3)
    q = ca.vertcat(given["position"], theta)
    turned = turned_by(theta)
    R = turned @ given["rotation"]

    def rate(expression: ca.SX) -> ca.SX:
        return ca.jtimes(expression, q, given["twist"])

    com, dR = given["position"] + R @ given["com"], rate(R)
    kinetic, potential = ca.trace(dR @ given["second_moments"] @ dR.T) / 2, ca.SX(0)
    lengths, directions, masses = _legs(given, R)
    for mass, x in [(given["mass"], com), *masses]:
        kinetic += mass * ca.sumsqr(rate(x)) / 2
        potential -= mass * ca.dot(given["gravity"], x)
    for transverse, s in directions:  # symmetric about s and without spin
        kinetic += transverse * ca.sumsqr(rate(s)) / 2
    omega = ca.inv_skew(rate(turned) @ turned.T)
    load = ca.dot(given["force"], rate(com)) + ca.dot(given["moment"], omega)
    return _System(given, q, lengths, kinetic, potential, load)


def _legs(given: dict[str, ca.SX], R: ca.SX) -> tuple[ca.SX, _Weighted, _Weighted]:
    """Returns lengths, (transverse inertia, direction) of the legs, (mass, position) of the links."""
    lengths, directions, masses = [], [], []
    for leg in range(6):
        base, lower, upper = (given[name][:, leg] for name in ("base_anchors", "lower", "upper"))
        # In this order a world frame far away costs no digits of R b.
        vector = (given["position"] - base) + R @ given["platform_anchors"][:, leg]
        lengths.append(ca.norm_2(vector))
        s = vector / lengths[-1]
        directions.append((lower[2] + upper[2], s))
        masses += [(lower[0], base + lower[1] * s), (upper[0], base + vector - upper[1] * s)]
    return ca.vertcat(*lengths), directions, masses
