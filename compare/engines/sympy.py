"""SymPy: Kane's equations of one leg and of the platform by sympy.physics.mechanics, lambdified.

The loops are cut at the platform joints B_i. Three equations of a leg give the force of its tip on
the platform; six equations of the platform, loaded by the tips, are J F = C. A body's orientation
is three angles from a home frame that stands still, at every sample another one: the frame in which
the angles are zero. So equations derived for all angles are evaluated at none but zero, and no
gimbal locks. They know no particular mechanism and are derived once a process.
"""

from __future__ import annotations

from functools import cache
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import sympy as sp
import sympy.physics.mechanics as me

from compare.engine import EngineForces, Progress
from sixsps.arrays import Array
from sixsps.errors import EngineError
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

_BLOCK = 200  # samples


class Formulas:
    """Vectors derived by SymPy, as a function of arrays.

    Attributes:
        arguments: sequences of symbols.
        vectors: column matrices of expressions.
    """

    def __init__(self, arguments: list[Any], vectors: list[Any]) -> None:
        self.arguments, self.vectors = arguments, vectors
        self._function = sp.lambdify(arguments, list(chain(*vectors)), modules="numpy", cse=True)

    def __call__(self, *values: Array) -> list[Array]:
        """Returns one array (..., size) per vector, from one array (..., symbols) per argument."""
        entries = self._function(*(np.moveaxis(value, -1, 0) for value in values))
        stacked = np.stack(np.broadcast_arrays(*entries), axis=-1)
        ends = np.cumsum([len(vector) for vector in self.vectors])
        return np.split(stacked, ends[:-1], axis=-1)


class PlatformFormulas(NamedTuple):
    """Kane's equations of the platform, taken apart; home axes, moments about O1.

    Attributes:
        tip_motion: velocity and acceleration of a platform joint.
        tip_wrench: generalised force (6) of a force on a platform joint.
        wrench: generalised force (6) that the tips have to supply.
    """

    tip_motion: Formulas
    tip_wrench: Formulas
    wrench: Formulas


@cache
def leg_formulas() -> Formulas:
    """Derives the force of a leg's tip on the platform, in home axes, of which the third is the leg.

    Returns:
        Tip force [N] of the passive leg, and per newton of its actuator, from the leg's length, the
        tip's velocity and acceleration, gravity, and (m, e, I) of the lower and of the upper link.
    """
    leg, gravity, F = _Leg(), _symbols("g", 3), sp.Symbol("F")
    force = leg.tip_force(gravity, F).xreplace(leg.rates())
    arguments = [[leg.length], leg.tip_velocity, leg.tip_acceleration, gravity, leg.links]
    return Formulas(arguments, [force.xreplace({F: 0}), force.diff(F)])


@cache
def platform_formulas() -> PlatformFormulas:
    """Derives the equations of the platform, in home axes.

    Returns:
        Functions of the twist (6) and the acceleration (6) of O1, of a platform joint c from O1 and
        the force on it; and of mass, com and inertia (xx, yy, zz, xy, xz, yz), gravity, external
        force and moment.
    """
    platform, gravity, load = _Platform(), _symbols("g", 3), _symbols("w", 6)
    tip_force = _symbols("f", 3)
    equations = platform.balance(gravity, load, tip_force)
    motion = [platform.speeds, platform.accelerations]
    tip_wrench = equations.jacobian(tip_force) * sp.Matrix(tip_force)
    wrench = -equations.xreplace(dict.fromkeys(tip_force, 0))
    return PlatformFormulas(
        Formulas([*motion, platform.joint], platform.tip_motion()),
        Formulas([platform.joint, tip_force], [tip_wrench]),
        Formulas([*motion, platform.inertia, gravity, load], [wrench]),
    )


class _Body:
    """A frame turned by three angles from its home frame, and equations evaluated at home."""

    def __init__(self) -> None:
        self.home, self.frame = me.ReferenceFrame("home"), me.ReferenceFrame("body")
        self._angles = me.dynamicsymbols("q_x q_y q_z")
        self.frame.orient_body_fixed(self.home, self._angles, "XYZ")

    def set_speeds(self, speeds: list[Any], angular_velocity: Any, rates: dict[Any, Any]) -> None:
        """Sets up Kane's method.

        Args:
            speeds: generalised speeds.
            angular_velocity: of the frame, in terms of the speeds.
            rates: coordinate -> speed that is its rate, besides the angles.
        """
        self.speeds, self.accelerations = speeds, _symbols("du", len(speeds))
        difference = self.frame.ang_vel_in(self.home) - angular_velocity
        self.frame.set_ang_vel(self.home, angular_velocity)
        kinematics = [difference.dot(axis) for axis in _axes(self.frame)]
        kinematics += [q.diff() - rate for q, rate in rates.items()]
        self._kane = me.KanesMethod(self.home, [*self._angles, *rates], speeds, kinematics)

    def equations(self, bodies: list[Any], loads: list[Any]) -> Any:
        """Returns Fr + Fr*, which has to be zero, at home."""
        active, inertial = self._kane.kanes_equations(bodies, loads)
        return self.at_home(active + inertial)

    def at_home(self, expressions: Any) -> Any:
        """Returns expressions where the angles are zero, in terms of speeds and accelerations."""
        derivatives = {u.diff(): du for u, du in zip(self.speeds, self.accelerations, strict=True)}
        at_zero = dict.fromkeys(self._angles, 0)
        return me.msubs(expressions, derivatives | self._kane.kindiffdict()).xreplace(at_zero)


class _Leg(_Body):
    """A leg that turns about A without spin, its links as rigid bodies, its tip B free."""

    def __init__(self) -> None:
        super().__init__()
        self.links = sp.symbols("m_d e_d I_d m_u e_u I_u")
        self.tip_velocity, self.tip_acceleration = _symbols("v", 3), _symbols("a", 3)
        self.length, u_x, u_y, u_l = me.dynamicsymbols("l u_x u_y u_l")
        z = self.frame.z
        self.set_speeds([u_x, u_y, u_l], u_x * self.frame.x + u_y * self.frame.y, {self.length: u_l})
        m_d, e_d, I_d, m_u, e_u, I_u = self.links
        self._A = me.Point("A")
        self._A.set_vel(self.home, 0)
        self._B = self._A.locatenew("B", self.length * z)
        self._B.set_vel(self.frame, u_l * z)
        self._B.v1pt_theory(self._A, self.home, self.frame)
        self._bodies = [self._link(self._A, m_d, e_d * z, I_d), self._link(self._B, m_u, -e_u * z, I_u)]

    def _link(self, joint: Any, mass: Any, com: Any, transverse: Any) -> Any:
        point = joint.locatenew("com", com)
        point.v2pt_theory(joint, self.home, self.frame)
        inertia = me.inertia(self.frame, transverse, transverse, sp.Symbol("axial"))
        return me.RigidBody("link", point, self.frame, mass, (inertia, point))

    def tip_force(self, gravity: Any, actuator: Any) -> Any:
        """Returns the force (3) on the platform, from Fr + Fr* = 0."""
        force, push = _symbols("f", 3), actuator * self.frame.z
        loads = [(self._A, -push), (self._B, push), (self._B, -_vector(self.frame, force))]
        loads += [(link.masscenter, link.mass * _vector(self.home, gravity)) for link in self._bodies]
        solution = _solve(self.equations(self._bodies, loads), force)
        return self.at_home(_vector(self.frame, solution).to_matrix(self.home))

    def rates(self) -> dict[Any, Any]:
        """Returns speeds and accelerations in terms of the tip's motion."""
        solution: dict[Any, Any] = {}
        for actual, given, unknowns in (
            (self._B.vel(self.home), self.tip_velocity, self.speeds),
            (self._B.acc(self.home), self.tip_acceleration, self.accelerations),
        ):
            difference = actual - _vector(self.home, given)
            equations = self.at_home(difference.to_matrix(self.frame))
            values = _solve(equations, unknowns).xreplace(solution)
            solution |= dict(zip(unknowns, values, strict=True))
        return solution


class _Platform(_Body):
    """The free platform; at home the speeds are the twist of O1, linear part first."""

    def __init__(self) -> None:
        super().__init__()
        self.inertia, self.joint = _symbols("I", 10), _symbols("c", 3)
        speeds, position = me.dynamicsymbols("u:6"), me.dynamicsymbols("x:3")
        # Along the body's axes, which at home are the same: with the home axes it takes twice the time.
        omega = _vector(self.frame, speeds[3:])
        self.set_speeds(speeds, omega, dict(zip(position, speeds[:3], strict=True)))
        mass, *com_and_inertia = self.inertia
        O1 = me.Point("O1")
        O1.set_vel(self.home, _vector(self.home, speeds[:3]))
        self._com, self._B = (
            O1.locatenew(name, _vector(self.frame, place))
            for name, place in (("com", com_and_inertia[:3]), ("B", self.joint))
        )
        for point in (self._com, self._B):
            point.v2pt_theory(O1, self.home, self.frame)
            point.a2pt_theory(O1, self.home, self.frame)
        xx, yy, zz, xy, xz, yz = com_and_inertia[3:]
        inertia = me.inertia(self.frame, xx, yy, zz, xy, yz, xz)
        self._platform = me.RigidBody("platform", self._com, self.frame, mass, (inertia, self._com))

    def tip_motion(self) -> list[Any]:
        """Returns velocity and acceleration (3) of a platform joint."""
        vectors = self._B.vel(self.home), self._B.acc(self.home)
        return [self.at_home(vector.to_matrix(self.home)) for vector in vectors]

    def balance(self, gravity: Any, load: Any, tip_force: Any) -> Any:
        """Returns Fr + Fr* (6) with a force and a moment on the platform and one tip's force."""
        weight = self._platform.mass * _vector(self.home, gravity)
        loads = [
            (self._com, weight + _vector(self.home, load[:3])),
            (self.frame, _vector(self.home, load[3:])),
            (self._B, _vector(self.home, tip_force)),
        ]
        return self.equations([self._platform], loads)


def _symbols(name: str, count: int) -> list[Any]:
    return list(sp.symbols(f"{name}:{count}"))


def _axes(frame: Any) -> list[Any]:
    return [frame.x, frame.y, frame.z]


def _vector(frame: Any, components: Any) -> Any:
    return sum((c * axis for c, axis in zip(components, _axes(frame), strict=True)), me.Vector(0))


def _solve(equations: Any, unknowns: list[Any]) -> Any:
    matrix, right = sp.linear_eq_to_matrix(equations, unknowns)
    return matrix.LUsolve(right)


class Sympy:
    """Equations of a leg and of the platform, derived apart and coupled by the tip forces."""

    formulation = "Kane's equations of one leg and of the platform by sympy.physics.mechanics"
    loops = "cut at the platform joints; a tip's force is the unknown that leg and platform share"
    shares = "R with kane"

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism
        halves = mechanism.lower, mechanism.upper
        self._links = np.hstack([np.column_stack([h.mass, h.com, h.transverse]) for h in halves])
        leg_formulas()  # derived here and not while samples are timed
        platform_formulas()

    @staticmethod
    def version() -> str:
        """Returns the version of SymPy."""
        return f"sympy {sp.__version__}"

    def inverse_dynamics(self, motion: Motion, progress: Progress) -> EngineForces:
        """Returns the leg forces along a motion; see `Engine`."""
        forces = np.empty((len(motion), 6))
        for start in range(0, len(motion), _BLOCK):
            block = slice(start, start + _BLOCK)
            forces[block] = self._block(motion[block])
            progress(min(start + _BLOCK, len(motion)))
        return EngineForces(forces)

    def _block(self, motion: Motion) -> Array:
        mechanism, R, gravity = self._mechanism, motion.rotation, self._mechanism.gravity
        # The platform's home axes are the world's: its joints, com and inertia come turned instead.
        c = mechanism.platform_anchors @ np.swapaxes(R, 1, 2)
        twist = np.hstack([motion.velocity, motion.angular_velocity])
        acceleration = np.hstack([motion.acceleration, motion.angular_acceleration])
        platform = platform_formulas()
        tip_motion = platform.tip_motion(twist[:, None], acceleration[:, None], c)
        legs = (motion.position[:, None] - mechanism.base_anchors) + c
        passive, active = self._tip_forces(legs, tip_motion)
        load = np.hstack([motion.force, motion.moment])
        (C,) = platform.wrench(twist, acceleration, self._turned_inertia(R), gravity, load)
        C -= platform.tip_wrench(c, passive)[0].sum(axis=1)
        J = np.swapaxes(platform.tip_wrench(c, active)[0], 1, 2)
        scale = np.repeat([1.0, mechanism.characteristic_length], 3)
        try:
            return np.linalg.solve(J / scale[:, None], (C / scale)[..., None])[..., 0]
        except np.linalg.LinAlgError as error:
            raise EngineError("J F = C has no solution: a pose is singular") from error

    def _tip_forces(self, legs: Array, tip_motion: list[Array]) -> list[Array]:
        """Returns (n, 6, 3) forces on the platform of the passive legs, and per newton of actuators."""
        lengths = np.linalg.norm(legs, axis=-1, keepdims=True)
        homes = _frames_along(legs / lengths)
        velocity, acceleration, gravity = (
            (vector[..., None, :] @ homes)[..., 0, :] for vector in (*tip_motion, self._mechanism.gravity)
        )
        forces = leg_formulas()(lengths, velocity, acceleration, gravity, self._links)
        return [(homes @ force[..., None])[..., 0] for force in forces]

    def _turned_inertia(self, R: Array) -> Array:
        """Returns (n, 10) mass, com and inertia of the platform, seen in world axes."""
        platform = self._mechanism.platform
        inertia = R @ platform.inertia @ np.swapaxes(R, 1, 2)
        entries = inertia[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        return np.hstack([np.full((len(R), 1), platform.mass), R @ platform.com, entries])


def _frames_along(directions: Array) -> Array:
    """Returns rotation matrices (..., 3, 3) whose third columns are these unit vectors (..., 3)."""
    x, y, z = np.moveaxis(directions, -1, 0)
    # Turned from the pole that is nearer, so that nothing is divided by less than 1.
    sign = np.copysign(1.0, z)
    k = 1 / (sign + z)
    first = np.stack([1 - sign * k * x * x, -sign * k * x * y, -sign * x], axis=-1)
    second = np.stack([-k * x * y, sign - k * y * y, -y], axis=-1)
    return np.stack([first, second, directions], axis=-1)
