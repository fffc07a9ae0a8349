"""The whole mechanism: what acts on the platform at the six joints and at its centre of mass.

Written down are: a point of the platform moves with P + c, c = R b turning with omega; a force at a
point is a wrench about O1; the platform obeys the equations of Newton and Euler. With the force that a
leg exerts on its platform joint (`leg.py`) they give the balance of wrenches

    C - J F = sum over the joints of [w; c x w] and what the platform's own motion takes = 0,

w = Q - s F being what a leg with its actuator takes at its joint; its slopes are put together in
`slopes.py`.
"""

from __future__ import annotations

import casadi as ca

from sixsps.parameters import MOTION_COLUMNS, PARAMETERS
from sixsps.symbolic.leg import LINKS, Leg, LegState, leg
from sixsps.symbolic.slopes import Points, Slopes

_E = ca.SX.eye(3)


class _Reader:
    """The parameter vector read from front to back."""

    def __init__(self, vector: ca.SX) -> None:
        self._vector, self._next = vector, 0

    def take(self, size: int) -> ca.SX:
        start, self._next = self._next, self._next + size
        return self._vector[start : self._next]


class Model:
    """Expressions of the mechanism in symbols of the platform's motion and of the parameters.

    Attributes:
        inputs: name -> symbol; pose, twist, acceleration, wrench, parameters.
        rotation: R as an expression of the quaternion, which is normalised inside.
        radius: RMS distance of the platform joints from O1 [m].
    """

    def __init__(self) -> None:
        sizes = {name: sum(width for _, width in parts) for name, parts in MOTION_COLUMNS.items()}
        sizes["parameters"] = len(PARAMETERS)
        self.inputs = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
        pose, twist, acceleration, wrench, parameters = self.inputs.values()
        self.position, self.rotation = pose[:3], _rotation(pose[3:])
        self.velocity, self.omega = twist[:3], twist[3:]
        self.acceleration, self.epsilon = acceleration[:3], acceleration[3:]
        self.force, self.moment = wrench[:3], wrench[3:]
        reader = _Reader(parameters)
        self.gravity = reader.take(3)
        self.base = ca.horzsplit(ca.reshape(reader.take(18), 3, 6))
        anchors = ca.reshape(reader.take(18), 3, 6)
        self.radius = ca.norm_2(ca.vec(anchors)) / ca.sqrt(6)
        self.mass, self.com = reader.take(1), reader.take(3)
        xx, yy, zz, xy, xz, yz = ca.vertsplit(reader.take(6))
        self.inertia = ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))
        self.links = [reader.take(LINKS) for _ in range(6)]
        self.arms = [self.rotation @ anchor for anchor in ca.horzsplit(anchors)]
        self.lever = self.rotation @ self.com
        self.states = [
            LegState.of(self.arms[k], self.joint(k), self.gravity, self.links[k]) for k in range(6)
        ]
        self.legs: list[Leg] = [leg(state) for state in self.states]

    def joint(self, index: int) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Returns the vector along a leg and its two derivatives: its platform joint's motion."""
        arm = self.arms[index]
        # In this order a world frame far away costs no digits of the arm.
        return (self.position - self.base[index]) + arm, self.velocity_of(arm), self.acceleration_of(arm)

    def velocity_of(self, arm: ca.SX) -> ca.SX:
        """Returns the velocity of the point of the platform at `arm` from O1."""
        return self.velocity + ca.cross(self.omega, arm)

    def acceleration_of(self, arm: ca.SX) -> ca.SX:
        """Returns the acceleration of the point of the platform at `arm` from O1."""
        turning = ca.cross(self.omega, arm)
        return self.acceleration + ca.cross(self.epsilon, arm) + ca.cross(self.omega, turning)

    def jacobian(self) -> ca.SX:
        """Returns J (6, 6), whose columns are the wrenches of unit leg forces."""
        pairs = zip(self.arms, self.legs, strict=True)
        return ca.horzcat(*(_wrench(arm, one.direction) for arm, one in pairs))

    def actuator_wrench(self) -> ca.SX:
        """Returns C (6,): what platform and legs need to move as they do."""
        joints = zip(self.arms, self.legs, strict=True)
        needed = [_wrench(arm, one.force) for arm, one in joints]
        load = self.mass * (self.acceleration_of(self.lever) - self.gravity) - self.force
        turning = ca.vertcat(ca.SX(3, 1), self._euler() - self.moment)
        return sum(needed, _wrench(self.lever, load) + turning)

    def _euler(self) -> ca.SX:
        """Rate of the platform's angular momentum, by Euler's equations in platform axes."""
        R, spin = self.rotation, self.inertia @ (self.rotation.T @ self.omega)
        omega, epsilon = R.T @ self.omega, R.T @ self.epsilon
        return R @ (self.inertia @ epsilon + ca.cross(omega, spin))

    def kinetic_energy(self) -> ca.SX:
        """Returns the kinetic energy [J]."""
        velocity, omega = self.velocity_of(self.lever), self.rotation.T @ self.omega
        platform = self.mass * ca.dot(velocity, velocity) + ca.dot(omega, self.inertia @ omega)
        return sum((one.kinetic for one in self.legs), platform / 2)

    def potential_energy(self) -> ca.SX:
        """Returns the potential energy in the field of gravity, zero at the world's origin [J]."""
        moment = self.mass * (self.position + self.lever)
        for base, arm, one, links in zip(self.base, self.arms, self.legs, self.links, strict=True):
            m_d, e_d, _, _, m_u, e_u, _, _ = ca.vertsplit(links)
            joint = self.position + arm
            moment += m_d * (base + e_d * one.direction) + m_u * (joint - e_u * one.direction)
        return -ca.dot(self.gravity, moment)

    def platform_slopes(self) -> tuple[Points, Slopes]:
        """Returns what the slopes of C - J F have of the platform itself: its mass, and its turning."""
        load = self.mass * (self.acceleration_of(self.lever) - self.gravity) - self.force
        zero = ca.SX(1, 1)
        return Points.one(self.lever, (zero, zero, self.mass), load), self._euler_slopes()

    def wrench_slope(self) -> ca.SX:
        """Returns the derivative (6, 6) of C - J F with respect to the external wrench."""
        return -ca.horzcat(ca.vertcat(_E, ca.skew(self.lever)), ca.vertcat(ca.SX(3, 3), _E))

    def _euler_slopes(self) -> Slopes:
        """Slopes of the moment that the platform's turning takes: I epsilon + omega x I omega, world axes."""
        inertia = self.rotation @ self.inertia @ self.rotation.T
        inertia = ca.triu2symm(ca.triu(inertia))
        turning, spin = ca.skew(self.omega), inertia @ self.omega
        moment = inertia @ self.epsilon + ca.cross(self.omega, spin)
        by_omega = turning @ inertia - ca.skew(spin)
        # Turned by dtheta, the platform sees omega and epsilon, which stay, turned the other way.
        by_pose = by_omega @ turning + inertia @ ca.skew(self.epsilon) - ca.skew(moment)
        return Slopes(*(_angular(block) for block in (by_pose, by_omega, inertia)))


def _wrench(arm: ca.SX, force: ca.SX) -> ca.SX:
    """Force and moment about O1 of a force at `arm`."""
    return ca.vertcat(force, ca.cross(arm, force))


def _angular(block: ca.SX) -> ca.SX:
    """A (3, 3) block as the moments by angular motion of a (6, 6) matrix."""
    return ca.diagcat(ca.SX(3, 3), block)


def _rotation(quaternion: ca.SX) -> ca.SX:
    w, x, y, z = ca.vertsplit(quaternion)
    k = 2 / ca.dot(quaternion, quaternion)
    return ca.vertcat(
        ca.horzcat(1 - k * (y * y + z * z), k * (x * y - w * z), k * (x * z + w * y)),
        ca.horzcat(k * (x * y + w * z), 1 - k * (x * x + z * z), k * (y * z - w * x)),
        ca.horzcat(k * (x * z - w * y), k * (y * z + w * x), 1 - k * (x * x + y * y)),
    )
