"""The whole mechanism: what acts on the platform at the six joints and at its centre of mass.

Written down are: a point of the platform moves with P + c, c = R b turning with omega; a force at a
point is a wrench about O1; the platform obeys the equations of Newton and Euler. With the force that a
leg exerts on its platform joint (`leg.py`) they give the balance of wrenches

    C - J F = sum over the joints of [w; c x w] and what the platform's own motion takes = 0,

w = Q - s F being what a leg with its actuator takes at its joint. Its slopes are the sums of those of its
parts: a leg feels position, velocity and acceleration of its platform joint, and each of these depends on
pose, twist and acceleration of the platform in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from sixsps.parameters import MOTION_COLUMNS, PARAMETERS
from sixsps.symbolic.leg import LINKS, Leg, joint_force_slopes, leg

_E = ca.SX.eye(3)


class _Reader:
    """The parameter vector read from front to back."""

    def __init__(self, vector: ca.SX) -> None:
        self._vector, self._next = vector, 0

    def take(self, size: int) -> ca.SX:
        start, self._next = self._next, self._next + size
        return self._vector[start : self._next]


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives (rows, 6) with respect to pose, twist and acceleration of the platform.

    The pose is perturbed to (P + dp, exp([dtheta]x) R); the others keep their world components.
    """

    by_pose: ca.SX
    by_twist: ca.SX
    by_acceleration: ca.SX

    def __add__(self, other: Slopes) -> Slopes:
        return Slopes(*(getattr(self, name) + getattr(other, name) for name in SLOPES))


SLOPES = ("by_pose", "by_twist", "by_acceleration")


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
        self.legs: list[Leg] = [leg(*self.joint(k), self.gravity, self.links[k]) for k in range(6)]

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

    def residual_slopes(self, forces: ca.SX) -> list[Slopes]:
        """Returns the slopes of C - J F at given leg forces F (6,).

        As running sums: of the platform, with the first leg, and so on; the last is the whole.
        """
        load = self.mass * (self.acceleration_of(self.lever) - self.gravity) - self.force
        platform = self._at_point(self.lever, load, [ca.SX(3, 3), ca.SX(3, 3), self.mass * _E])
        sums = [platform + self._euler_slopes()]
        for k, arm in enumerate(self.arms):
            slopes = joint_force_slopes(*self.joint(k), self.gravity, self.links[k], forces[k])
            needed = self.legs[k].force - self.legs[k].direction * forces[k]
            sums.append(sums[-1] + self._at_point(arm, needed, slopes))
        return sums

    def wrench_slope(self) -> ca.SX:
        """Returns the derivative (6, 6) of C - J F with respect to the external wrench."""
        return -ca.horzcat(_wrenches(self.lever, _E), ca.vertcat(ca.SX(3, 3), _E))

    def _at_point(self, arm: ca.SX, force: ca.SX, slopes: list[ca.SX]) -> Slopes:
        """Slopes of the wrench of a force at a point of the platform.

        Args:
            arm: (3,) of the point from O1.
            force: (3,) there.
            slopes: derivatives (3, 3) of the force by position, velocity, acceleration of the point.
        """
        by_position, by_velocity, by_acceleration = slopes
        across, turning = ca.skew(arm), ca.skew(self.omega)
        # d(omega x c) = [omega]x dc and d(epsilon x c + omega x (omega x c)) = field dc, dc = -[c]x dtheta.
        field = ca.skew(self.epsilon) + turning @ turning
        moved = by_position + by_velocity @ turning + by_acceleration @ field
        spun = ca.skew(ca.cross(self.omega, arm)) + turning @ across
        pose = _wrenches(arm, ca.horzcat(by_position, -moved @ across))
        lever = ca.vertcat(ca.SX(3, 3), ca.skew(force) @ across)  # (dtheta x c) x w
        return Slopes(
            pose + ca.horzcat(ca.SX(6, 3), lever),
            _wrenches(arm, ca.horzcat(by_velocity, -by_velocity @ across - by_acceleration @ spun)),
            _symmetric(by_acceleration, by_acceleration @ across, across),
        )

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


def _wrenches(arm: ca.SX, forces: ca.SX) -> ca.SX:
    """Wrenches (6, m) of forces (3, m) at `arm`."""
    return ca.vertcat(forces, ca.skew(arm) @ forces)


def _symmetric(mass: ca.SX, turned: ca.SX, across: ca.SX) -> ca.SX:
    """Slope (6, 6) by acceleration of the wrench of a force at a point: a mass matrix, each entry once.

    Args:
        mass: (3, 3) symmetric, slope of the force by the point's acceleration.
        turned: mass [c]x.
        across: [c]x.
    """
    corner = ca.triu(-across @ turned)
    return ca.blockcat([[mass, -turned], [-turned.T, ca.triu2symm(corner)]])


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
