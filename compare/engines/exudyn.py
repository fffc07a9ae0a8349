"""Exudyn: thirteen free bodies in redundant coordinates, their joints as algebraic equations.

Platform, lower and upper links have seven coordinates each: the centre of mass, world axes, and the
four Euler parameters of the orientation; 91 in all. The balls at A_i and B_i, the sliding joints
between the halves of a leg, the six driven lengths and the norms of the Euler parameters are 85
algebraic equations with Jacobian Jc, one multiplier each; what they leave free are the idle spins.
Velocities and accelerations of the links follow from those same equations, differentiated. The mass
matrix M and the forces f (gravity, load, gyroscopic) then give Jc^T p = M q'' - f, 91 equations of
rank 85, solved by least squares (QR); the six p of the driven lengths are the leg forces.
"""

from __future__ import annotations

from typing import Any

import exudyn as exu
import numpy as np
from exudyn import itemInterface
from scipy.linalg.lapack import dgels

from compare.engine import EngineForces, Progress
from sixsps.arrays import Array
from sixsps.bodies import Leg
from sixsps.errors import EngineError
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

# Its classes carry no types.
_ITEMS: Any = itemInterface
_PROGRESS_STEP = 100
_BODY = 7
_COORDINATES = 13 * _BODY
# What Exudyn adds to the coordinates that it is given: its Euler parameters start from no rotation.
_REFERENCE = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], 13)
_LEG_COLUMNS = _BODY + np.arange(12 * _BODY).reshape(6, 2 * _BODY)
# Weights of a central difference with steps 1, 2 and 3, exact for polynomials up to degree 6.
_DIFFERENCE = ((1.0, 45 / 60), (2.0, -9 / 60), (3.0, 1 / 60))
# Change of an Euler parameter in one step: less loses digits in the difference, more in the powers.
_STEP = 0.5
_NO_RATE = 1e-100


class Bodies:
    """The thirteen bodies in Exudyn: platform, then the lower and the upper link of each leg.

    Lower and upper links have their x axis along the leg. Vectors of algebraic equations and of
    multipliers are (85,), in Exudyn's order.

    Attributes:
        balls: (12, 3) equations of the balls at A_1, B_1, A_2, ...: p_link - p_base or p_platform,
            world axes [m].
        slides: (6, 5) equations of the sliding joints, lower link's y and z axes against the upper
            link's position and axes.
        lengths: (6,) equations of the driven lengths, positive multiplier p in extension.
        norms: (13,) equations of the Euler parameters.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._container = exu.SystemContainer()
        self._system: Any = self._container.AddSystem()
        self._data: Any = self._system.systemData
        self._gravity = mechanism.gravity.tolist()
        ground = self._system.AddObject(_ITEMS.ObjectGround())
        inertia, com = mechanism.platform.inertia, mechanism.platform.com
        upper_triangle = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))]
        platform = self._body(mechanism.platform.mass, upper_triangle)
        joints = []
        for leg, base, anchor in zip(
            mechanism.legs, mechanism.base_anchors, mechanism.platform_anchors, strict=True
        ):
            joints.append(self._leg(leg, self._marker(ground, base), self._marker(platform, anchor - com)))
        centre = self._marker(platform, np.zeros(3))
        self._force = self._system.AddLoad(_ITEMS.LoadForceVector(markerNumber=centre))
        self._moment = self._system.AddLoad(_ITEMS.LoadTorqueVector(markerNumber=centre))
        self._system.Assemble()
        self._solver = _solver(self._system)
        self.balls = np.array([self._equations(ball) for balls, _, _ in joints for ball in balls])
        self.slides = np.array([self._equations(slide) for _, slide, _ in joints])
        self._drives = [length for _, _, length in joints]
        self.lengths = np.array([self._equations(length)[0] for length in self._drives])
        self.norms = np.setdiff1d(np.arange(85), [*self.balls.flat, *self.slides.flat, *self.lengths])
        norms = self.norms[1:].reshape(6, 2)
        self._leg_rows = np.hstack([self.balls.reshape(6, 6), self.slides, norms])

    def _body(self, mass: float, inertia: list[float]) -> Any:
        """Adds a body with its weight; `inertia` is xx, yy, zz, yz, xz, xy about its centre of mass."""
        node = self._system.AddNode(_ITEMS.NodeRigidBodyEP(referenceCoordinates=_REFERENCE[:_BODY].tolist()))
        body = _ITEMS.ObjectRigidBody(mass=mass, inertia=inertia, nodeNumber=node)
        number = self._system.AddObject(body)
        marker = self._system.AddMarker(_ITEMS.MarkerBodyMass(bodyNumber=number))
        weight = _ITEMS.LoadMassProportional(markerNumber=marker, loadVector=self._gravity)
        self._system.AddLoad(weight)
        return number

    def _marker(self, body: Any, position: Array) -> Any:
        marker = _ITEMS.MarkerBodyRigid(bodyNumber=body, localPosition=position.tolist())
        return self._system.AddMarker(marker)

    def _leg(self, leg: Leg, base: Any, anchor: Any) -> tuple[list[Any], Any, Any]:
        """Adds two links between two markers; returns the balls, the sliding joint and the length."""
        lower, upper = (
            self._body(link.mass, [link.axial, link.transverse, link.transverse, 0.0, 0.0, 0.0])
            for link in (leg.lower, leg.upper)
        )
        foot = self._marker(lower, np.array([-leg.lower.com, 0.0, 0.0]))
        tip = self._marker(upper, np.array([leg.upper.com, 0.0, 0.0]))
        ends = [foot, tip]
        balls = [_ITEMS.ObjectJointSpherical(markerNumbers=pair) for pair in ([base, foot], [anchor, tip])]
        slide = _ITEMS.ObjectJointPrismaticX(markerNumbers=ends)
        # Neither Jacobian nor multiplier depends on the distance, which only has to be positive.
        length = _ITEMS.ObjectConnectorDistance(markerNumbers=ends, distance=1.0)
        add = self._system.AddObject
        return [add(ball) for ball in balls], add(slide), add(length)

    def _equations(self, constraint: Any) -> list[int]:
        return list(self._data.GetObjectLTGAE(constraint))

    def jacobian(self, q: Array) -> Array:
        """Returns Jc (85, 91), the derivative of the algebraic equations."""
        self._data.SetODE2Coordinates(q - _REFERENCE)
        size = _COORDINATES + 85
        self._solver.SetSystemJacobian(np.zeros((size, size)))  # Exudyn adds to what is there
        self._solver.ComputeJacobianAE(self._system)
        jacobian: Array = self._solver.GetSystemJacobian()[_COORDINATES:, :_COORDINATES]
        return jacobian

    def gaps(self, q: Array) -> Array:
        """Returns (85,) what is left of the algebraic equations at the coordinates q."""
        self._data.SetODE2Coordinates(q - _REFERENCE)
        self._solver.ComputeAlgebraicEquations(self._system)
        return self._left()

    def gap_rates(self, q: Array, v: Array) -> Array:
        """Returns (85,) time derivatives of the algebraic equations at the velocities v = q'."""
        self._data.SetODE2Coordinates(q - _REFERENCE)
        self._data.SetODE2Coordinates_t(v)
        self._solver.ComputeAlgebraicEquations(self._system, velocityLevel=True)
        return self._left()

    def _left(self) -> Array:
        left: Array = self._solver.GetSystemResidual()[_COORDINATES:]
        return left

    def drift(self, q: Array, v: Array) -> Array:
        """Returns (85,) Jc' v, the accelerations of the equations at q'' = 0; the lengths' are not exact.

        The others' velocities are polynomials in q of degree 5 at most (a rotation matrix is one of
        degree 2), so that the difference quotient along v is exact but for rounding.
        """
        fastest = np.abs(v.reshape(13, _BODY)[:, 3:]).max()
        step = _STEP / max(fastest, _NO_RATE)
        drift = np.zeros(85)
        for steps, weight in _DIFFERENCE:
            move = steps * step * v
            drift += weight / step * (self.gap_rates(q + move, v) - self.gap_rates(q - move, v))
        return drift

    def move_legs(self, q: Array, v: Array, a: Array) -> Array:
        """Sets the legs' velocities and accelerations in v and a (91,) from the platform's; returns Jc.

        Of each leg, 14 unknowns: its joints stay closed (11 equations), its Euler parameters keep
        their norms (two), and the leg does not spin (one).
        """
        jacobian = self.jacobian(q)
        matrix, right = np.empty((6, 14, 14)), np.zeros((6, 14, 1))
        matrix[:, :13] = jacobian[self._leg_rows[:, :, None], _LEG_COLUMNS[:, None, :]]
        matrix[:, 13] = _spin_rows(q)
        driven = jacobian[self._leg_rows, :_BODY]
        right[:, :13, 0] = -driven @ v[:_BODY]
        v[_LEG_COLUMNS] = np.linalg.solve(matrix, right)[..., 0]
        right[:, :13, 0] = -driven @ a[:_BODY] - self.drift(q, v)[self._leg_rows]
        a[_LEG_COLUMNS] = np.linalg.solve(matrix, right)[..., 0]
        return jacobian

    def required(self, q: Array, v: Array, a: Array, force: Array, moment: Array) -> Array:
        """Returns M a - f (91,): the generalised forces that joints and actuators have to supply.

        Args:
            q: (91,) coordinates.
            v: (91,) their velocities.
            a: (91,) their accelerations.
            force: (3,) external force on the platform's centre of mass, world axes [N].
            moment: (3,) external moment on the platform, world axes [N m].
        """
        self._data.SetODE2Coordinates(q - _REFERENCE)
        self._data.SetODE2Coordinates_t(v)
        self._system.SetLoadParameter(self._force, "loadVector", force)
        self._system.SetLoadParameter(self._moment, "loadVector", moment)
        self._solver.ComputeMassMatrix(self._system)
        self._solver.ComputeODE2RHS(self._system)
        required: Array = self._solver.GetSystemMassMatrix() @ a
        return required - self._solver.GetSystemResidual()[:_COORDINATES]


class Exudyn:
    """Thirteen bodies in redundant coordinates; the forces are multipliers of driven leg lengths."""

    formulation = "free bodies in redundant coordinates (Euler parameters), Lagrange multipliers"
    loops = "ball, sliding and distance joints as algebraic equations; all 85 multipliers by QR"
    shares = "R of the platform's anchors with kane"

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism
        try:
            self._bodies = Bodies(mechanism)
        except exu.ExudynError as error:
            raise EngineError(f"exudyn does not accept the mechanism: {one_line(error)}") from error

    @staticmethod
    def version() -> str:
        """Returns the version of Exudyn."""
        return f"exudyn {exu.__version__}"

    def inverse_dynamics(self, motion: Motion, progress: Progress) -> EngineForces:
        """Returns the leg forces along a motion; see `Engine`."""
        positions = coordinates(self._mechanism, motion)
        rates, accelerations = platform_rates(self._mechanism, motion, positions[:, 3:_BODY])
        results = np.empty((len(motion), 8))
        for k, q in enumerate(positions):
            wrench = motion.force[k], motion.moment[k]
            try:
                results[k] = _solve(self._bodies, q, rates[k], accelerations[k], wrench)
            except exu.ExudynError as error:
                raise EngineError(f"exudyn fails at given sample {k + 1}: {one_line(error)}") from error
            if (k + 1) % _PROGRESS_STEP == 0 or k + 1 == len(motion):
                progress(k + 1)
        return EngineForces(results[:, :6], results[:, 6], results[:, 7])


def coordinates(mechanism: Mechanism, motion: Motion) -> Array:
    """Returns q (n, 91) of all bodies, from where the platform puts its anchors."""
    q = np.empty((len(motion), 13, _BODY))
    q[:, 0, :3] = motion.position + motion.rotation @ mechanism.platform.com
    q[:, 0, 3:] = _nearest(motion.quaternion)
    arms = mechanism.platform_anchors @ np.swapaxes(motion.rotation, 1, 2)
    vectors = (motion.position[:, None] - mechanism.base_anchors) + arms
    directions = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    lower, upper = q[:, 1::2], q[:, 2::2]
    lower[..., :3] = mechanism.base_anchors + mechanism.lower.com[:, None] * directions
    upper[..., :3] = mechanism.base_anchors + (vectors - mechanism.upper.com[:, None] * directions)
    lower[..., 3:] = upper[..., 3:] = _turn_from_x(directions)
    return q.reshape(-1, _COORDINATES)


def platform_rates(mechanism: Mechanism, motion: Motion, e: Array) -> tuple[Array, Array]:
    """Returns the platform's velocities and accelerations (n, 7) at its Euler parameters e (n, 4)."""
    omega, epsilon = motion.angular_velocity, motion.angular_acceleration
    lever = motion.rotation @ mechanism.platform.com
    turning = np.cross(omega, lever)
    acceleration = motion.acceleration + np.cross(epsilon, lever) + np.cross(omega, turning)
    # e' = [0, omega] e / 2 as quaternions; differentiated, with [0, omega] [0, omega] = -omega^2.
    bending = np.sum(omega**2, axis=1, keepdims=True) / 4 * e
    return (
        np.hstack([motion.velocity + turning, _half_product(omega, e)]),
        np.hstack([acceleration, _half_product(epsilon, e) - bending]),
    )


def _half_product(vectors: Array, e: Array) -> Array:
    """Returns half the quaternion products [0, vector] e, (n, 4)."""
    scalar = -np.sum(vectors * e[:, 1:], axis=1, keepdims=True)
    return np.hstack([scalar, e[:, :1] * vectors + np.cross(vectors, e[:, 1:])]) / 2


def _turn_from_x(directions: Array) -> Array:
    """Returns Euler parameters (..., 4) of a rotation that turns x to the unit vectors (..., 3).

    The shortest turn from x, or, where -x is nearer, half a turn about z and the shortest from -x.
    """
    x, y, z = np.moveaxis(directions, -1, 0)
    ahead = np.stack([1 + x, np.zeros_like(x), -z, y], axis=-1)
    behind = np.stack([y, z, np.zeros_like(x), 1 - x], axis=-1)
    return _nearest(np.where(x[..., None] < 0, behind, ahead))


def _nearest(quaternions: Array) -> Array:
    """Returns Euler parameters of unit length with the first one positive.

    Exudyn is given their difference from [1, 0, 0, 0]; with the other sign it would cost digits.
    """
    lengths = np.linalg.norm(quaternions, axis=-1, keepdims=True)
    return quaternions / np.copysign(lengths, quaternions[..., :1])


def _spin_rows(q: Array) -> Array:
    """Returns (6, 14) rows that give the lower links' rates about their own x axes, omega_x / 2."""
    e = q.reshape(13, _BODY)[1::2, 3:]
    rows = np.zeros((6, 2 * _BODY))
    rows[:, 3:_BODY] = np.column_stack([-e[:, 1], e[:, 0], e[:, 3], -e[:, 2]])
    return rows


def _solver(system: Any) -> Any:
    """Returns what evaluates the system's terms; nothing is ever integrated in time."""
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    # Until they get coordinates, all bodies lie in one place, where no accelerations exist.
    settings.timeIntegration.generalizedAlpha.computeInitialAccelerations = False
    solver: Any = exu.MainSolverImplicitSecondOrder()
    if not solver.InitializeSolver(system, settings):
        raise EngineError("exudyn cannot initialise its solver")
    return solver


def _solve(bodies: Bodies, q: Array, rate: Array, acceleration: Array, wrench: tuple[Array, Array]) -> Array:
    """Returns (8,) leg forces [N], largest residual [N, N m] and largest gap of a ball [m]."""
    v, a = np.zeros(_COORDINATES), np.zeros(_COORDINATES)
    v[:_BODY], a[:_BODY] = rate, acceleration
    matrix = bodies.move_legs(q, v, a).T
    required = bodies.required(q, v, a, *wrench)
    multipliers, residual = multipliers_for(matrix, required)
    gaps = bodies.gaps(q)[bodies.balls]
    gap = np.sqrt((gaps**2).sum(axis=1).max())
    return np.array([*multipliers[bodies.lengths], np.abs(residual).max(), gap])


def multipliers_for(matrix: Array, required: Array) -> tuple[Array, Array]:
    """Solves Jc^T p = required for all multipliers at once.

    Forces and moments, heavy and light bodies share the equations. One step of iterative refinement
    takes errors from 13 to 3 cond(J) unit roundoffs (1000 random states).

    Returns:
        (85,) p, minus Exudyn's lambda, and (91,) what they leave of `required`.
    """
    multipliers, residual = np.zeros(85), required
    for _ in range(2):
        _, solution, info = dgels(matrix, residual)
        if info != 0:
            raise EngineError(f"the solve for the multipliers failed: dgels returned {info}")
        multipliers += solution[:85]
        residual = required - matrix @ multipliers
    return multipliers, residual


def one_line(error: Exception) -> str:
    """Returns the message of an error of Exudyn without its line breaks."""
    return " ".join(str(error).split())
