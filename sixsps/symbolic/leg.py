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

_MOMENTS = 4


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
    """The scalars that coefficients depend on."""

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


@dataclass(frozen=True, eq=False)
class LegState:
    """Everything that the forces of a leg and their slopes are made of.

    Attributes:
        arm: c (3,), from O1 to the platform joint [m].
        vectors: s, S', S'', g as columns (3, 4).
        scalars: what coefficients depend on.
        moments: (4,) mass of the upper link, its first moment from B towards A with a minus sign, the
            second moment of both links about their joints, the first moment of both along s.
    """

    arm: ca.SX
    vectors: ca.SX
    scalars: _Scalars
    moments: ca.SX

    SIZE = 3 + 9 + 5 + _MOMENTS
    """Numbers that `packed` takes."""

    @classmethod
    def of(cls, arm: ca.SX, joint: tuple[ca.SX, ca.SX, ca.SX], gravity: ca.SX, links: ca.SX) -> LegState:
        """Returns the state of a leg.

        Args:
            arm: (3,) from O1 to the platform joint [m].
            joint: S (3,) from base joint to platform joint, and its first two derivatives.
            gravity: (3,) [m/s^2].
            links: (8,) mass, com, transverse and axial inertia of the lower and the upper link.
        """
        S, dS, ddS = joint
        inverse = 1 / ca.sqrt(ca.dot(S, S))
        s = S * inverse
        scalars = _Scalars(inverse, ca.dot(s, dS), ca.dot(dS, dS), ca.dot(s, ddS), ca.dot(s, gravity))
        return cls(arm, ca.horzcat(s, dS, ddS, gravity), scalars, _moments(links))

    def packed(self) -> ca.SX:
        """Returns all but gravity as a column (SIZE,)."""
        return ca.vertcat(self.arm, ca.vec(self.vectors[:, :3]), self.scalars.all(), self.moments)

    @classmethod
    def unpacked(cls, column: ca.SX, gravity: ca.SX) -> LegState:
        """Returns the state that `packed` has written."""
        arm, vectors, scalars, moments = ca.vertsplit(column, [0, 3, 12, 17, cls.SIZE])
        moving = ca.horzcat(ca.reshape(vectors, 3, 3), gravity)
        return cls(arm, moving, _Scalars(*ca.vertsplit(scalars)), moments)


def _moments(links: ca.SX) -> ca.SX:
    m_d, e_d, I_d, _, m_u, e_u, I_u, _ = ca.vertsplit(links)
    # The lower link stands on A at rest; the upper one hangs on B, at A + S, towards A.
    moment = -m_u * e_u
    second = (I_d + m_d * e_d * e_d) + (I_u + m_u * e_u * e_u)
    return ca.vertcat(m_u, moment, second, m_d * e_d + moment)


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
    """Returns symbols of scalars and moments, the coefficients of Q, and the kinetic energy."""
    names = ("inverse", "rate", "speed_squared", "pull", "weight")
    scalars, moments = _Scalars(*(ca.SX.sym(name) for name in names)), ca.SX.sym("moments", _MOMENTS)
    span = _Span(scalars)
    mass, moment, second, first = ca.vertsplit(moments)
    p = mass * span.velocity + moment * span.turning
    p_s = moment * span.velocity + second * span.turning
    at_joint = span.rate_of(p) - mass * span.gravity
    at_direction = span.rate_of(p_s) - first * span.gravity
    Q = at_joint + span.across(at_direction) * scalars.inverse
    kinetic = (span.product(p, span.velocity) + span.product(p_s, span.turning)) / 2
    return scalars, moments, Q, kinetic


def leg(state: LegState) -> Leg:
    """Returns what a leg does."""
    at, vectors = state.scalars, state.vectors
    symbols, moments, Q, kinetic = _coefficients()
    Q, kinetic = ca.substitute([Q, kinetic], [symbols.all(), moments], [at.all(), state.moments])
    return Leg(1 / at.inverse, vectors[:, 0], at.rate, at.acceleration, vectors @ Q, kinetic)


@dataclass(frozen=True, eq=False)
class LegSlopes:
    """Derivatives of w = Q - s F, what a leg takes with its actuator, by S, S' and S''.

    Each is  equal E + V inner V^T,  V having the columns s, S', S'', g.

    Attributes:
        vectors: V (3, 4).
        force: w (3,).
        equal: three scalars, for S, S', S''.
        inner: three matrices (4, 4), with entries in row 0, in column 0 and at (1, 1) only.
    """

    vectors: ca.SX
    force: ca.SX
    equal: tuple[ca.SX, ca.SX, ca.SX]
    inner: tuple[ca.SX, ca.SX, ca.SX]


def leg_slopes(state: LegState, force: ca.SX) -> LegSlopes:
    """Returns how what a leg takes depends on its motion.

    Args:
        state: of the leg.
        force: F, of the actuator, held [N].
    """
    at = state.scalars
    symbols, moments, Q, _ = _coefficients()
    F = ca.SX.sym("F")
    k = ca.vertcat(Q[0] - F, Q[1:])
    old, new = [symbols.all(), moments, F], [at.all(), state.moments, force]
    k, slopes = ca.substitute([k, ca.jacobian(k, symbols.all())], old, new)
    span = _Span(at)
    # Gradients of the five scalars by S, S' and S'', a row each in the order of `_Scalars`.
    zero = ca.SX(1, 4)
    pull, weight = (span.across(vector).T * at.inverse for vector in (span.acceleration, span.gravity))
    by_S = [-at.inverse * at.inverse * span.s.T, span.turning.T, zero, pull, weight]
    by_dS = [zero, span.s.T, 2 * span.velocity.T, zero, zero]
    by_ddS = [zero, zero, zero, span.s.T, zero]
    inner_S, inner_dS, inner_ddS = (slopes @ ca.vertcat(*rows) for rows in (by_S, by_dS, by_ddS))
    # The vector s itself turns with S, by (E - s s^T) / l.
    turning = k[0] * at.inverse
    inner_S -= turning * (span.s @ span.s.T)
    return LegSlopes(state.vectors, state.vectors @ k, (turning, k[1], k[2]), (inner_S, inner_dS, inner_ddS))
