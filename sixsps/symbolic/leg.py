"""One leg as a function of the motion of S, the vector from its base joint to its platform joint.

Both links lie along s = S / l and do not spin about it, so that each is a mass on that line: its mass,
first and second moment about its own joint say all. Written down are their momenta, p with S' and
p_s with s'. By d'Alembert's principle in Jourdain's form the platform joint has to exert

    Q = (dS'/dS')^T (p' - m_u g) + (ds'/dS')^T (p_s' - f g),    f: first moment along s of both links.

Every vector here stays in the span of s, S', S'' and g and is carried by its four coefficients. They
depend on five scalars, l, l', S'.S', s.S'' and s.g, through which rates and slopes are taken by
algorithmic differentiation: a fraction of the operations of differentiating the vectors.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

LINKS = 8
"""Numbers that describe the two links of a leg: mass, com, transverse, axial of lower and upper."""


@dataclass(frozen=True, eq=False)
class Leg:
    """What a leg does, in the symbols that `leg` was given.

    Attributes:
        length: l [m].
        direction: s, (3,).
        rate: l' [m/s].
        acceleration: l'' [m/s^2].
        force: Q (3,), what the platform exerts on the leg besides the actuator's share [N].
        kinetic: kinetic energy of both links [J].
    """

    length: ca.SX
    direction: ca.SX
    rate: ca.SX
    acceleration: ca.SX
    force: ca.SX
    kinetic: ca.SX


@dataclass(frozen=True, eq=False)
class _Scalars:
    """The scalars that coefficients depend on, as symbols."""

    inverse: ca.SX  # 1 / l, in which everything is a polynomial
    rate: ca.SX
    speed_squared: ca.SX
    pull: ca.SX  # s.S''
    weight: ca.SX  # s.g

    @property
    def acceleration(self) -> ca.SX:
        """Second rate of the length, (s.S')' = s'.S' + s.S''."""
        return self.pull + (self.speed_squared - self.rate * self.rate) * self.inverse

    def all(self) -> ca.SX:
        return ca.vertcat(self.inverse, self.rate, self.speed_squared, self.pull, self.weight)


class _Span:
    """Vectors as coefficients (4,) along s, S', S'', g."""

    def __init__(self, scalars: _Scalars) -> None:
        self.at = scalars
        self.s, self.velocity, self.acceleration, self.gravity = (ca.SX(ca.DM.eye(4)[:, k]) for k in range(4))
        self.turning = (self.velocity - scalars.rate * self.s) * scalars.inverse  # s'

    def rate_of(self, vector: ca.SX) -> ca.SX:
        """Time derivative of a vector in the span of s and S' whose coefficients depend on l and l'."""
        at = self.at
        moving = ca.vertcat(at.inverse, at.rate)
        moved = ca.vertcat(-at.rate * at.inverse * at.inverse, at.acceleration)
        change = ca.jtimes(vector, moving, moved)
        return change + vector[0] * self.turning + vector[1] * self.acceleration

    def across(self, vector: ca.SX) -> ca.SX:
        """A vector without its component along s; what it has of s itself does not count."""
        at = self.at
        others = vector[1] * at.rate + vector[2] * at.pull + vector[3] * at.weight
        return ca.vertcat(-others, vector[1:])

    def product(self, a: ca.SX, b: ca.SX) -> ca.SX:
        """Scalar product of two vectors in the span of s and S'."""
        mixed = (a[0] * b[1] + a[1] * b[0]) * self.at.rate
        return a[0] * b[0] + mixed + a[1] * b[1] * self.at.speed_squared


@lru_cache(maxsize=1)
def _coefficients() -> tuple[_Scalars, ca.SX, ca.SX, ca.SX]:
    """Returns the scalars, the links' numbers, the coefficients of Q, and the kinetic energy."""
    names = ("inverse", "rate", "speed_squared", "pull", "weight")
    scalars, links = _Scalars(*(ca.SX.sym(name) for name in names)), ca.SX.sym("links", LINKS)
    span = _Span(scalars)
    m_d, e_d, I_d, _, m_u, e_u, I_u, _ = ca.vertsplit(links)
    # The lower link stands on A at rest; the upper one hangs on B, at A + S, towards A.
    moment = -m_u * e_u
    second = (I_d + m_d * e_d * e_d) + (I_u + m_u * e_u * e_u)
    p = m_u * span.velocity + moment * span.turning
    p_s = moment * span.velocity + second * span.turning
    at_joint = span.rate_of(p) - m_u * span.gravity
    at_direction = span.rate_of(p_s) - (m_d * e_d + moment) * span.gravity
    Q = at_joint + span.across(at_direction) * scalars.inverse
    kinetic = (span.product(p, span.velocity) + span.product(p_s, span.turning)) / 2
    return scalars, links, Q, kinetic


def _values(S: ca.SX, dS: ca.SX, ddS: ca.SX, gravity: ca.SX) -> tuple[_Scalars, ca.SX]:
    """Returns the scalars of a leg in motion, and the vectors s, S', S'', g as columns (3, 4)."""
    inverse = 1 / ca.sqrt(ca.dot(S, S))
    s = S * inverse
    scalars = _Scalars(inverse, ca.dot(s, dS), ca.dot(dS, dS), ca.dot(s, ddS), ca.dot(s, gravity))
    return scalars, ca.horzcat(s, dS, ddS, gravity)


def leg(S: ca.SX, dS: ca.SX, ddS: ca.SX, gravity: ca.SX, links: ca.SX) -> Leg:
    """Returns what a leg does.

    Args:
        S: (3,) from base joint to platform joint [m].
        dS: (3,) its first derivative [m/s].
        ddS: (3,) its second derivative [m/s^2].
        gravity: (3,) [m/s^2].
        links: (8,) mass, com, transverse and axial inertia of the lower and the upper link.
    """
    at, vectors = _values(S, dS, ddS, gravity)
    symbols, numbers, Q, kinetic = _coefficients()
    Q, kinetic = ca.substitute([Q, kinetic], [symbols.all(), numbers], [at.all(), links])
    return Leg(ca.sqrt(ca.dot(S, S)), vectors[:, 0], at.rate, at.acceleration, vectors @ Q, kinetic)


def joint_force_slopes(
    S: ca.SX, dS: ca.SX, ddS: ca.SX, gravity: ca.SX, links: ca.SX, force: ca.SX
) -> list[ca.SX]:
    """Returns the derivatives (3, 3) of Q - s F, what a leg takes with its actuator, by S, S' and S''.

    Args:
        S: (3,) from base joint to platform joint [m].
        dS: (3,) its first derivative [m/s].
        ddS: (3,) its second derivative [m/s^2].
        gravity: (3,) [m/s^2].
        links: (8,) as for `leg`.
        force: F, of the actuator, held [N].
    """
    at, vectors = _values(S, dS, ddS, gravity)
    symbols, numbers, Q, _ = _coefficients()
    F = ca.SX.sym("F")
    k = ca.vertcat(Q[0] - F, Q[1:])
    old, new = [symbols.all(), numbers, F], [at.all(), links, force]
    k, slopes = ca.substitute([k, ca.jacobian(k, symbols.all())], old, new)
    span = _Span(at)
    # Gradients of the five scalars by S, S' and S'', a row each in the order of `_Scalars`.
    zero = ca.SX(1, 4)
    pull, weight = (span.across(vector).T * at.inverse for vector in (span.acceleration, span.gravity))
    by_S = [-at.inverse * at.inverse * span.s.T, span.turning.T, zero, pull, weight]
    by_dS = [zero, span.s.T, 2 * span.velocity.T, zero, zero]
    by_ddS = [zero, zero, zero, span.s.T, zero]
    inner = [slopes @ ca.vertcat(*rows) for rows in (by_S, by_dS, by_ddS)]
    # The vector s itself turns with S, by (E - s s^T) / l.
    turning = k[0] * at.inverse
    inner[0] -= turning * (span.s @ span.s.T)
    plain = (turning, k[1], k[2])
    return [own * ca.SX.eye(3) + _in_world(vectors, one) for own, one in zip(plain, inner, strict=True)]


def _in_world(vectors: ca.SX, matrix: ca.SX) -> ca.SX:
    """Returns V M V^T (3, 3), for M with entries in row 0, in column 0 and at (1, 1) only."""
    s, velocity = vectors[:, 0], vectors[:, 1]
    squares = matrix[0, 0] * (s @ s.T) + matrix[1, 1] * (velocity @ velocity.T)
    return squares + s @ (vectors[:, 1:] @ matrix[0, 1:].T).T + (vectors[:, 1:] @ matrix[1:, 0]) @ s.T
