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
        force: Q (3,), what the platform exerts on the leg besides the actuator [N].
        momentum: its kinetic energy is half of the momenta times S' and s' [J].
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

    length: ca.SX
    rate: ca.SX
    speed_squared: ca.SX
    pull: ca.SX  # s.S''
    weight: ca.SX  # s.g

    @property
    def acceleration(self) -> ca.SX:
        """l'' = (s.S')' = s'.S' + s.S''."""
        return self.pull + (self.speed_squared - self.rate * self.rate) / self.length

    def all(self) -> ca.SX:
        return ca.vertcat(self.length, self.rate, self.speed_squared, self.pull, self.weight)


class _Span:
    """Vectors as coefficients (4,) along s, S', S'', g."""

    def __init__(self, scalars: _Scalars) -> None:
        self.at = scalars
        self.s, self.velocity, self.acceleration, self.gravity = (
            ca.SX(ca.DM.eye(4)[:, k]) for k in range(4)
        )
        self.turning = (self.velocity - scalars.rate * self.s) / scalars.length  # s'

    def rate_of(self, vector: ca.SX) -> ca.SX:
        """Time derivative of a vector in the span of s and S' whose coefficients depend on l and l'."""
        at = self.at
        moving = ca.vertcat(at.length, at.rate)
        change = ca.jtimes(vector, moving, ca.vertcat(at.rate, at.acceleration))
        return change + vector[0] * self.turning + vector[1] * self.acceleration

    def along(self, vector: ca.SX) -> ca.SX:
        """Component of a vector along s."""
        return vector[0] + vector[1] * self.at.rate + vector[2] * self.at.pull + vector[3] * self.at.weight

    def across(self, vector: ca.SX) -> ca.SX:
        """A vector without its component along s."""
        return ca.vertcat(vector[0] - self.along(vector), vector[1:])

    def product(self, a: ca.SX, b: ca.SX) -> ca.SX:
        """Scalar product of two vectors in the span of s and S'."""
        mixed = (a[0] * b[1] + a[1] * b[0]) * self.at.rate
        return a[0] * b[0] + mixed + a[1] * b[1] * self.at.speed_squared


@lru_cache(maxsize=1)
def _coefficients() -> tuple[_Scalars, ca.SX, ca.SX, ca.SX]:
    """Returns the scalars, the links' numbers, the coefficients of Q, and the kinetic energy."""
    names = ("length", "rate", "speed_squared", "pull", "weight")
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
    Q = at_joint + span.across(at_direction) / scalars.length
    kinetic = (span.product(p, span.velocity) + span.product(p_s, span.turning)) / 2
    return scalars, links, Q, kinetic


def _values(S: ca.SX, dS: ca.SX, ddS: ca.SX, gravity: ca.SX) -> tuple[_Scalars, ca.SX]:
    """Returns the scalars of a leg in motion, and the vectors s, S', S'', g as columns (3, 4)."""
    length = ca.sqrt(ca.dot(S, S))
    s = S / length
    scalars = _Scalars(length, ca.dot(s, dS), ca.dot(dS, dS), ca.dot(s, ddS), ca.dot(s, gravity))
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
    return Leg(at.length, vectors[:, 0], at.rate, at.acceleration, vectors @ Q, kinetic)


def joint_force_slopes(
    S: ca.SX, dS: ca.SX, ddS: ca.SX, gravity: ca.SX, links: ca.SX, force: ca.SX
) -> list[ca.SX]:
    """Returns the derivatives (3, 3) of s F - Q, the force of a leg on the platform, by S, S' and S''.

    Args:
        S: (3,) from base joint to platform joint [m].
        dS: (3,) its first derivative [m/s].
        ddS: (3,) its second derivative [m/s^2].
        gravity: (3,) [m/s^2].
        links: (8,) as for `leg`.
        force: F, of the actuator, held [N].
    """
    at, vectors = _values(S, dS, ddS, gravity)
    s = vectors[:, 0]
    symbols, numbers, Q, _ = _coefficients()
    F = ca.SX.sym("F")
    k = ca.vertcat(F - Q[0], -Q[1:])
    old, new = [symbols.all(), numbers, F], [at.all(), links, force]
    k, slopes = ca.substitute([k, ca.jacobian(k, symbols.all())], old, new)

    def across(vector: ca.SX, along: ca.SX) -> ca.SX:
        """d(s.vector)/dS, for a vector whose component along s is known."""
        return (vector - s * along).T / at.length

    zero, E = ca.SX(1, 3), ca.SX.eye(3)
    # Gradients of the five scalars, in the order of `_Scalars`.
    by_S = ca.vertcat(s.T, across(dS, at.rate), zero, across(ddS, at.pull), across(gravity, at.weight))
    by_dS = ca.vertcat(zero, s.T, 2 * dS.T, zero, zero)
    by_ddS = ca.vertcat(zero, zero, zero, s.T, zero)
    turned = k[0] * (E - s @ s.T) / at.length
    return [
        turned + vectors @ (slopes @ by_S),
        k[1] * E + vectors @ (slopes @ by_dS),
        k[2] * E + vectors @ (slopes @ by_ddS),
    ]
