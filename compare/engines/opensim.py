"""OpenSim: the open tree built joint by joint, Simbody's inverse dynamics, and one linear solve.

OpenSim reads neither URDF nor MJCF, so the model is put together here: a BallJoint at each base
joint, a SliderJoint along each leg, a FreeJoint for the platform, and a PointConstraint at each
platform joint. InverseDynamicsSolver ignores constraints: it gives the 30 generalised forces tau
that the open tree would need. Six actuators and 18 closure forces have to supply them:
[S, G^T] [F; lambda] = tau, 30 equations of rank 24, solved by least squares (QR), with G the
constraint Jacobian of Simbody. What remains of it is the check that the motion obeys the closures.

BallJoint and FreeJoint have three angles, R = Rx Ry Rz, as coordinates, but their speeds are the
angular velocity in the axes of the parent, here the ground. Only the rates of the angles are divided
by the cosine that vanishes in gimbal lock, and no force depends on them.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import opensim
from numpy.typing import NDArray
from scipy.linalg.lapack import dgels

from compare.engine import EngineForces, Progress
from sixsps.arrays import Array
from sixsps.bodies import Link
from sixsps.errors import EngineError
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

# With its first message it would open opensim.log in the working directory.
opensim.Logger.setLevelString("off")
opensim.Logger.removeFileSink()

_PROGRESS_STEP = 100
_LEGS = np.arange(6)
_TURNS = np.array([True] * 3 + [False] * 3 + [True, True, True, False] * 6)  # of 30 coordinates


class _Tree:
    """The open tree in OpenSim with its closures.

    Coordinates stand in this order in all arrays outside: rotation and translation of the platform
    (6), then rotation and length of every leg (4).
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.model = opensim.Model()
        self.model.setGravity(_vec3(mechanism.gravity))
        self._platform = _add_platform(self.model, mechanism)
        for leg in range(6):
            _add_leg(self.model, mechanism, leg, self._platform)
        self._state = self.model.initSystem()
        for leg in range(6):
            self.model.getConstraintSet().get(leg).setIsEnforced(self._state, True)
        self._matter = self.model.getMatterSubsystem()
        self._solver = opensim.InverseDynamicsSolver(self.model)
        self._com = _vec3(mechanism.platform.com)
        self._q, self._u = self._places()
        self._q_values = np.zeros(self._state.getNQ())

    def _places(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Returns where coordinates stand: Simbody numbers them by depth, and with gaps in q."""
        coordinates = self.model.getCoordinateSet()
        for k in range(30):
            coordinates.get(k).setValue(self._state, 1.0 + k, False)
            coordinates.get(k).setSpeedValue(self._state, 1.0 + k)
        q, u = self._state.getQ().to_numpy(), self._state.getU().to_numpy()
        return np.argsort(q)[-30:], np.argsort(u)

    def place(self, q: Array) -> tuple[Array, float]:
        """Sets the coordinates q (30,).

        Returns:
            (18, 30) constraint Jacobian G, and the largest distance between the ends of a loop [m].
        """
        self._q_values[self._q] = q
        self._state.setQ(_vector(self._q_values))
        self.model.realizePosition(self._state)
        jacobian = opensim.Matrix()
        self._matter.calcG(self._state, jacobian)
        gaps = self._state.getQErr().to_numpy().reshape(6, 3)
        return jacobian.to_numpy()[:, self._u], float(np.sqrt((gaps**2).sum(axis=1).max()))

    def move(self, u: Array) -> Array:
        """Sets the speeds u (30,).

        Returns:
            (18,) relative accelerations of the ends of the loops at du/dt = 0 [m/s^2].
        """
        self._state.setU(self._in_place(u))
        self.model.realizeVelocity(self._state)
        bias = opensim.Vector()
        self._matter.calcBiasForAccelerationConstraints(self._state, bias)
        return bias.to_numpy()

    def forces(self, du: Array, force: Array, moment: Array) -> Array:
        """Returns the generalised forces tau (30,) of the open tree.

        Args:
            du: (30,) rates of the speeds.
            force: (3,) on the platform's centre of mass, world axes [N].
            moment: (3,) on the platform, world axes [N m].
        """
        needed = self._solver.solve(self._state, self._in_place(du))
        index, load = self._platform.getMobilizedBodyIndex(), opensim.SpatialVec(_vec3(moment), _vec3(force))
        given = opensim.Vector()
        self._matter.multiplyByFrameJacobianTranspose(self._state, index, self._com, load, given)
        return (needed.to_numpy() - given.to_numpy())[self._u]

    def _in_place(self, values: Array) -> Any:
        placed = np.empty(30)
        placed[self._u] = values
        return _vector(placed)


def _add_platform(model: Any, mechanism: Mechanism) -> Any:
    """Returns the platform's body, riding on a FreeJoint, frames at O and O1."""
    given = mechanism.platform
    xx, yy, zz, xy, xz, yz = given.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    body = _add_body(model, "platform", given.mass, given.com, (xx, yy, zz, xy, xz, yz))
    _add_joint(model, opensim.FreeJoint, "platform_joint", model.getGround(), (0, 0, 0), body)
    return body


def _add_leg(model: Any, mechanism: Mechanism, leg: int, platform: Any) -> None:
    """Adds a leg along the x axis of its links, as a SliderJoint slides, and the closure of its loop."""
    links, name = mechanism.legs[leg], f"leg{leg + 1}"
    lower = _add_link(model, f"{name}_lower", links.lower, 1.0)
    upper = _add_link(model, f"{name}_upper", links.upper, -1.0)
    ground, anchor = model.getGround(), mechanism.base_anchors[leg]
    _add_joint(model, opensim.BallJoint, f"{name}_ball", ground, anchor, lower)
    _add_joint(model, opensim.SliderJoint, f"{name}_actuator", lower, (0, 0, 0), upper)
    tip, anchor = _vec3((0, 0, 0)), _vec3(mechanism.platform_anchors[leg])
    closure = opensim.PointConstraint(upper, tip, platform, anchor)
    # Enforced from the start, it would make initSystem search for a pose that closes the loops.
    closure.set_isEnforced(False)
    model.addConstraint(closure)


def _add_link(model: Any, name: str, link: Link, sense: float) -> Any:
    """Returns the body of a link that extends from its joint along x in the direction of `sense`."""
    inertia = (link.axial, link.transverse, link.transverse, 0, 0, 0)
    return _add_body(model, name, link.mass, (sense * link.com, 0, 0), inertia)


def _add_body(model: Any, name: str, mass: float, com: Iterable[float], inertia: Iterable[float]) -> Any:
    """Returns a new body; inertia about the com, in the order xx, yy, zz, xy, xz, yz."""
    moments = opensim.Inertia(*(float(value) for value in inertia))
    body = opensim.Body(name, mass, _vec3(com), moments)
    model.addBody(body)
    return body


def _add_joint(model: Any, kind: Any, name: str, parent: Any, place: Iterable[float], body: Any) -> None:
    zero = _vec3((0, 0, 0))
    model.addJoint(kind(name, parent, _vec3(place), zero, body, zero, zero))


def _vec3(vector: Iterable[float]) -> Any:
    return opensim.Vec3(*(float(value) for value in vector))


def _vector(array: Array) -> Any:
    return opensim.Vector.createFromMat(np.ascontiguousarray(array))


class Opensim:
    """Inverse dynamics of the open tree by Simbody and the solve for actuator and closure forces.

    Attributes:
        model: the OpenSim model.
    """

    formulation = "recursive Newton-Euler (InverseDynamicsSolver) of the open tree"
    loops = "tree built in OpenSim, ball joints; PointConstraint at the platform joints, [S, G^T] by QR"
    shares = "R with kane"

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism
        self._tree = _Tree(mechanism)
        self.model = self._tree.model

    @staticmethod
    def version() -> str:
        """Returns the version of OpenSim."""
        return f"opensim {opensim.__version__}"

    def inverse_dynamics(self, motion: Motion, progress: Progress) -> EngineForces:
        """Returns the leg forces along a motion; see `Engine`."""
        tree, results = self._tree, np.empty((len(motion), 8))
        q, directions = _positions(self._mechanism, motion)
        v = np.hstack([motion.angular_velocity, motion.velocity])
        dv = np.hstack([motion.angular_acceleration, motion.acceleration])
        length = self._mechanism.characteristic_length
        for k in range(len(motion)):
            G, gap = tree.place(q[k])
            bias = tree.move(_all_rates(G, directions[k], v[k]))
            du = _all_rates(G, directions[k], dv[k], bias)
            tau = tree.forces(du, motion.force[k], motion.moment[k])
            results[k] = *_close_loops(G, tau, length), gap
            if (k + 1) % _PROGRESS_STEP == 0 or k + 1 == len(motion):
                progress(k + 1)
        return EngineForces(results[:, :6], results[:, 6], results[:, 7])


def _positions(mechanism: Mechanism, motion: Motion) -> tuple[Array, Array]:
    """Returns coordinates q (n, 30) and the directions (n, 6, 3) of the legs."""
    arms = np.einsum("nij,kj->nki", motion.rotation, mechanism.platform_anchors)
    # In this order a world frame far away costs no digits of the arms.
    vectors = (motion.position[:, None] - mechanism.base_anchors) + arms
    lengths = np.linalg.norm(vectors, axis=2)
    x, y, z = np.moveaxis(vectors, 2, 0)
    # x axis of Rx(q1) Rz(q3): with q2 = 0 a leg never comes near gimbal lock. It does not feel its roll.
    legs = np.stack([np.arctan2(z, y), np.zeros_like(x), np.arctan2(np.hypot(y, z), x), lengths], axis=2)
    q = np.hstack([_angles(motion.rotation), motion.position, legs.reshape(-1, 24)])
    return q, vectors / lengths[..., None]


def _angles(rotation: Array) -> Array:
    """Returns the angles (n, 3) of Rx Ry Rz; in gimbal lock too they give back R to rounding."""
    R = np.moveaxis(rotation, 0, 2)
    about_x = np.arctan2(-R[1, 2], R[2, 2])
    c, s = np.cos(about_x), np.sin(about_x)
    # The others from Ry Rz = Rx^T R.
    about_y = np.arctan2(R[0, 2], c * R[2, 2] - s * R[1, 2])
    about_z = np.arctan2(c * R[1, 0] + s * R[2, 0], c * R[1, 1] + s * R[2, 1])
    return np.column_stack([about_x, about_y, about_z])


def _all_rates(G: Array, directions: Array, of_platform: Array, bias: Array | float = 0.0) -> Array:
    """Returns (30,) rates of all coordinates from the platform's (6,), such that G rates + bias = 0.

    Of each leg four are unknown: three equations of its loop, and the leg does not spin. As s turns
    with the leg, the spin's acceleration is zero too: epsilon . s = 0.
    """
    matrix, right = np.zeros((6, 4, 4)), np.zeros((6, 4, 1))
    matrix[:, :3] = G[:, 6:].reshape(6, 3, 6, 4)[_LEGS, :, _LEGS]
    matrix[:, 3, :3] = directions
    right[:, :3, 0] = -(G[:, :6] @ of_platform + bias).reshape(6, 3)
    return np.concatenate([of_platform, np.linalg.solve(matrix, right).ravel()])


def _close_loops(G: Array, tau: Array, length: float) -> Array:
    """Solves [S, G^T] [F; lambda] = tau.

    Args:
        G: (18, 30) constraint Jacobian.
        tau: (30,) generalised forces of the open tree.
        length: what moments are divided by, to stand beside forces in one sum of squares [m].

    Returns:
        (7,) six leg forces [N], and the largest entry of the residual [N, N m].
    """
    units = np.where(_TURNS, length, 1.0)
    matrix, right = np.zeros((30, 24)), tau / units
    matrix[9 + 4 * _LEGS, _LEGS] = 1.0
    matrix[:, 6:] = G.T / units[:, None]
    solution, rest = np.zeros(24), right
    for _ in range(2):  # the second time for what is left, which takes most of the rounding away
        _, correction, info = dgels(matrix, rest)
        if info != 0:
            raise EngineError(f"the loop-closing solve failed: dgels returned {info}")
        solution += correction[:24]
        rest = right - matrix @ solution
    return np.array([*solution[:6], np.abs(rest * units).max()])
