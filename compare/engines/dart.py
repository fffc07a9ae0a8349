"""DART: the generated tree, inverse dynamics of it cut open, and one linear solve for its loops.

DART reads the URDF itself: a ball is three revolute joints, the platform rides on a FreeJoint. Of the
MJCF it refuses the platform's three slides and ball.

Cut open at the platform joints, the tree has 30 velocities, which the platform's motion fixes but for
the legs' idle spins, and these are zero. DART's inverse dynamics gives the generalised forces tau that
the open tree would need; six actuators and 18 closure forces have to supply them:
[S, Jc^T] [F; lambda] = tau, 30 equations of rank 24, solved by least squares (QR), with Jc from DART's
Jacobians at the two ends of each loop. On universal joints there are 24 velocities, spin is fixed with
them, and the 24 equations have one solution.
"""

from __future__ import annotations

import math
from typing import Any

import dartpy
import numpy as np
from scipy.linalg.lapack import dgels
from scipy.spatial.transform import Rotation

from compare.engine import EngineForces, Progress
from sixsps.arrays import Array
from sixsps.errors import EngineError
from sixsps.legs import Legs
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from urdf import parse_closures, render_closures, render_urdf

_PROGRESS_STEP = 100
_LEGS = np.arange(6)
_AXES = np.arange(3)[:, None]
# DART takes a link without inertia for 1 kg and 1 kg m^2, and warns of zeros. So little is gone after
# the first addition.
_NO_MASS = 1e-200
# DART cuts the exponential map off after the square below 1e-3 rad, which is wrong by angle^3 / 6:
# 1.7e-10 there, and lost in rounding below the first of these angles.
_COARSE_ANGLES = (1e-6, 2e-3)
# The cosine beyond which rounding shows, as for the same joints in the engine `pinocchio`.
_GIMBAL_LOCK = 0.05
_LOCKED = {
    Legs.sps: "gimbal lock of a URDF ball (three revolute joints) at given sample {}: a leg stands across "
    "its home direction; the pose is regular, use pinocchio-ball",
    Legs.ups: "gimbal lock of a universal joint at given sample {}: a leg stands along its first axis",
}


class _Tree:
    """The open tree in DART, and where the two ends of each loop and their coordinates are."""

    def __init__(self, mechanism: Mechanism, legs: Legs) -> None:
        self.legs = legs
        self.skeleton = _load(render_urdf(mechanism, legs))
        self.skeleton.setGravity(mechanism.gravity)
        closures = parse_closures(render_closures())
        self.tips = [self._body(tip) for tip, _ in closures.closed_loop]
        self.anchors = [self._body(anchor) for _, anchor in closures.closed_loop]
        self.platform = self._body("platform")
        self.com = self.platform.getLocalCOM()
        self.size = self.skeleton.getNumDofs()
        self.leg_columns = np.array([_columns(tip) for tip in self.tips])
        self.platform_columns = np.array(_columns(self.platform))
        actuators = [_known(self.skeleton.getDof(name), name) for name in closures.name_mot]
        self.actuated = [actuator.getIndexInSkeleton() for actuator in actuators]
        # Moments over a length of the mechanism: its unit must not decide what rounding does.
        self.length = mechanism.characteristic_length
        self.units = np.ones(self.size)
        self.units[self.leg_columns[:, :-1]] = self.units[self.platform_columns[:3]] = self.length

    def positions(self, motion: Motion) -> Array:
        """Returns all joint positions (n, size), a leg's from where the platform puts its anchor."""
        q = np.zeros((len(motion), self.size))
        home = _placement(self.platform).translation()
        q[:, self.platform_columns] = np.hstack([_rotation_vectors(motion), motion.position - home])
        for leg, (anchor, columns) in enumerate(zip(self.anchors, self.leg_columns, strict=True)):
            frame = _placement(self._body(f"leg{leg + 1}_about_x"))
            arm = motion.rotation @ _placement(anchor).translation()
            vector = ((motion.position - frame.translation()) + arm) @ frame.rotation()
            # Of a ball the third angle stays zero: it turns the leg about itself, which it does not feel.
            q[:, columns[:2]] = self._swing(vector)
            at_zero = _placement(self._body(f"leg{leg + 1}_upper")).translation()[2]
            q[:, columns[-1]] = np.linalg.norm(vector, axis=1) - at_zero
        return q

    def jacobians(self) -> tuple[Array, Array]:
        """Returns the Jacobians of the tips (6, 3, leg's rates) and the anchors (6, 3, 6), world axes."""
        tips = np.array([tip.getLinearJacobian() for tip in self.tips])
        return tips, np.array([anchor.getLinearJacobian() for anchor in self.anchors])

    def _swing(self, vectors: Array) -> Array:
        """Returns (n, 2) angles about x, then y, that turn the z axis to `vectors` (n, 3)."""
        x, y, z = vectors.T
        across = np.hypot(y, z)
        locked = across < _GIMBAL_LOCK * np.hypot(x, across)
        if locked.any():
            raise EngineError(_LOCKED[self.legs].format(int(np.argmax(locked)) + 1))
        return np.column_stack([np.arctan2(-y, z), np.arctan2(x, across)])

    def _body(self, name: str) -> Any:
        return _known(self.skeleton.getBodyNode(name), name)


class _DartEngine:
    """Inverse dynamics of the open tree and the solve for actuator and closure forces."""

    formulation = "recursive Newton-Euler (computeInverseDynamics) of the open tree"
    legs: Legs

    def __init__(self, mechanism: Mechanism) -> None:
        self._tree = _Tree(mechanism, self.legs)

    @staticmethod
    def version() -> str:
        """Returns the version of DART."""
        return f"dartpy {dartpy.__version__}"

    def inverse_dynamics(self, motion: Motion, progress: Progress) -> EngineForces:
        """Returns the leg forces along a motion; see `Engine`."""
        tree = self._tree
        # A FreeJoint's rates are angular, then linear, in the parent's axes; its acceleration is classical.
        rates = np.hstack([motion.angular_velocity, motion.velocity])
        accelerations = np.hstack([motion.angular_acceleration, motion.acceleration])
        results = np.empty((len(motion), 8))
        for k, q in enumerate(tree.positions(motion)):
            tree.skeleton.setPositions(q)
            tips, anchors = tree.jacobians()
            _set_rates(tree, (tips, anchors), rates[k], accelerations[k])
            # In this order: setExtTorque would wipe out the moment of a force off the origin.
            tree.platform.setExtForce(motion.force[k], tree.com, False, True)
            tree.platform.addExtTorque(motion.moment[k], False)
            tree.skeleton.computeInverseDynamics(True, False, False)
            results[k] = _close_loops(tree, (tips, anchors), tree.skeleton.getForces())
            if (k + 1) % _PROGRESS_STEP == 0 or k + 1 == len(motion):
                progress(k + 1)
        return EngineForces(results[:, :6], results[:, 6], results[:, 7])


class Dart(_DartEngine):
    """Legs on balls, each three revolute joints."""

    loops = "URDF tree, balls as revolute joints; Jacobians at the platform joints, [S, Jc^T] by QR"
    shares = "all code of this file with the other legs; the URDF with pinocchio; R with kane"
    legs = Legs.sps


class DartUps(_DartEngine):
    """Legs on universal joints, which make them spin a little."""

    loops = "URDF tree, universal joints; Jacobians at the platform joints, [S, Jc^T] by QR"
    shares = Dart.shares
    legs = Legs.ups


def _load(urdf: str) -> Any:
    """Returns the skeleton that DART reads from `urdf`, its base fixed to the world."""
    nothing = dartpy.dynamics.Inertia(_NO_MASS, np.zeros(3), _NO_MASS * np.eye(3))
    fixed = dartpy.utils.DartLoaderRootJointType.FIXED
    loader = dartpy.utils.DartLoader()
    loader.setOptions(dartpy.utils.DartLoaderOptions(None, fixed, nothing))
    return _known(loader.parseSkeletonString(urdf, dartpy.common.Uri()), "skeleton")


def _known(part: Any, name: str) -> Any:
    if part is None:
        raise EngineError(f"the model that DART loaded has no {name}")
    return part


def _columns(body: Any) -> list[int]:
    """Returns the coordinates that move a body, from the base on."""
    return [body.getDependentGenCoordIndex(k) for k in range(body.getNumDependentGenCoords())]


def _placement(body: Any) -> Any:
    """Returns the pose of a body relative to its parent when the joint between them is at zero."""
    return body.getParentJoint().getTransformFromParentBodyNode()


def _rotation_vectors(motion: Motion) -> Array:
    """Returns (n, 3) rotation vectors of the platform, with a full turn added where DART needs it."""
    vectors: Array = Rotation.from_quat(motion.quaternion, scalar_first=True).as_rotvec()
    angles = np.linalg.norm(vectors, axis=1)
    low, high = _COARSE_ANGLES
    coarse = (low < angles) & (angles < high)
    vectors[coarse] *= 1 + 2 * math.pi / angles[coarse, None]
    return vectors


def _set_rates(tree: _Tree, jacobians: tuple[Array, Array], rate: Array, acceleration: Array) -> None:
    """Sets velocities and accelerations of all coordinates, leg by leg from those of the platform joint.

    Of each leg, four unknown rates: its tip moves with the anchor (three equations) and the leg
    does not spin (one); on a universal joint three rates, and what spin there is follows from them.
    Accelerations follow from the same matrix, less what velocities alone cause.
    """
    (tips, anchors), skeleton = jacobians, tree.skeleton
    v, a = np.zeros(tree.size), np.zeros(tree.size)
    v[tree.platform_columns], a[tree.platform_columns] = rate, acceleration
    matrix, right = tips, anchors @ rate
    axes = np.empty((0, 3))
    if tree.legs is Legs.sps:
        axes = np.array([tip.getWorldTransform().rotation()[:, 2] for tip in tree.tips])
        turning = zip(tree.length * axes, tree.tips, strict=True)
        spins = [axis @ tip.getAngularJacobian() for axis, tip in turning]
        matrix = np.concatenate([tips, np.array(spins)[:, None]], axis=1)
        right = np.column_stack([right, np.zeros(6)])
    v[tree.leg_columns] = np.linalg.solve(matrix, right[..., None])[..., 0]
    skeleton.setVelocities(v)
    skeleton.setAccelerations(a)
    for leg, (tip, anchor) in enumerate(zip(tree.tips, tree.anchors, strict=True)):
        right[leg, :3] = anchor.getLinearAcceleration() - tip.getLinearAcceleration()
        if tree.legs is Legs.sps:
            # The spin omega . s stays zero, and s turns with omega: epsilon . s = 0.
            right[leg, 3] = -tree.length * axes[leg] @ tip.getAngularAcceleration()
    a[tree.leg_columns] = np.linalg.solve(matrix, right[..., None])[..., 0]
    skeleton.setAccelerations(a)


def _close_loops(tree: _Tree, jacobians: tuple[Array, Array], tau: Array) -> Array:
    """Solves [S, Jc^T] [F; lambda] = tau at the positions that are set.

    Returns:
        (8,) six leg forces [N], the largest entry of the residual [N, N m], and the largest
        distance between the ends of a loop [m].
    """
    closures = np.zeros((6, 3, tree.size))
    closures[_LEGS[:, None, None], _AXES, tree.leg_columns[:, None]] = jacobians[0]
    closures[..., tree.platform_columns] = -jacobians[1]
    matrix = np.zeros((tree.size, 24))
    matrix[tree.actuated, _LEGS] = 1.0
    matrix[:, 6:] = closures.reshape(18, tree.size).T
    _, solution, info = dgels(matrix / tree.units[:, None], tau / tree.units)
    if info != 0:
        raise EngineError(f"the loop-closing solve failed: dgels returned {info}")
    residual = np.abs(tau - matrix @ solution[:24]).max()
    gaps = np.array([tip.getWorldTransform().translation() for tip in tree.tips])
    gaps -= [anchor.getWorldTransform().translation() for anchor in tree.anchors]
    return np.array([*solution[:6], residual, np.sqrt((gaps**2).sum(axis=1).max())])
