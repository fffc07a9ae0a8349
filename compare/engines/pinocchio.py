"""Pinocchio: the generated tree, its loop closures as constraints, RNEA and one linear solve.

The tree is cut open at the platform joints and has 30 velocities: 6 of the platform and 4 of each
leg. The platform's motion fixes them all but the legs' idle spins, which are zero. RNEA gives the
30 generalised forces tau that the open tree would need; six actuators and 18 closure forces have to
supply them: [S, Jc^T] [F; lambda] = tau, 30 equations of rank 24, solved by least squares (QR). What
remains of it is the check that the motion obeys the closures. On universal joints a leg has 3
velocities, its spin among what the platform's motion fixes, and the 24 equations have one solution.
"""

from __future__ import annotations

import tempfile
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.linalg.lapack import dgels

from compare.engine import EngineForces, Progress
from sixsps.arrays import Array
from sixsps.errors import EngineError
from sixsps.legs import Legs
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from urdf import parse_closures, render_closures, render_mjcf, render_urdf
from urdf.closures import CLOSURES

_PROGRESS_STEP = 100
# The cosine beyond which rounding shows: on wu2012 errors are 1e-14 at 1e-2, 1e-12 at 1e-3 and 4e-9 at 1e-4,
# in general as 4 / cosine times cond(J) times unit roundoff.
_GIMBAL_LOCK = 0.05
_LEGS = range(1, 7)
_WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class _Tree(ABC):
    """The open tree in Pinocchio with its closures; subclasses know what its joints are."""

    platform_joint: str
    leg_joint: str

    def __init__(self, model: Any, closures: Any, pairs: tuple[tuple[str, str], ...], length: float) -> None:
        self.model, self.data = model, model.createData()
        self.closures, self.closure_data = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
        for closure in closures:
            self.closures.append(pin.ConstraintModel(closure))
            self.closure_data.append(self.closures[-1].createData())
        self.tips = [self._frame(tip) for tip, _ in pairs]
        self.anchors = [self._frame(anchor) for _, anchor in pairs]
        self.roots = [self._joint(self.leg_joint.format(leg)) for leg in _LEGS]
        self.actuators = [self._joint(name) for name in CLOSURES.name_mot]
        self.lowers = [model.parents[actuator] for actuator in self.actuators]
        self.platform = self._joint(self.platform_joint)
        self.actuated = [model.joints[joint].idx_v for joint in self.actuators]
        starts = [model.joints[joint].idx_v for joint in self.roots]
        ends = [column + 1 for column in self.actuated]
        self.leg_columns = np.array([np.arange(*ends) for ends in zip(starts, ends, strict=True)])
        start = model.joints[self.platform].idx_v
        self.platform_columns = slice(start, start + 6)
        # Moments over a length of the mechanism: its unit must not decide what rounding does.
        self.length = length
        self.units = np.ones(model.nv)
        self.units[self.leg_columns[:, :-1]] = self.units[start + 3 : start + 6] = length

    @abstractmethod
    def platform_positions(self, motion: Motion) -> Array:
        """Returns the platform joint's part of q."""

    @abstractmethod
    def platform_rates(self, motion: Motion) -> tuple[Array, Array]:
        """Returns the platform joint's parts (n, 6) of the velocity and the acceleration."""

    @abstractmethod
    def ball_positions(self, directions: Array) -> Array:
        """Returns the ball's part of q that turns the leg's z axis to `directions` (n, 3)."""

    def positions(self, motion: Motion) -> Array:
        """Returns all joint positions q (n, nq), from where the platform puts the anchors."""
        q = np.empty((len(motion), self.model.nq))
        self._fill(q, self.platform, self.platform_positions(motion))
        for root, actuator, anchor in zip(self.roots, self.actuators, self.anchors, strict=True):
            joint = motion.position + motion.rotation @ self.model.frames[anchor].placement.translation
            frame = self.model.jointPlacements[root]
            vector = (joint - frame.translation) @ frame.rotation
            length = np.linalg.norm(vector, axis=1, keepdims=True)
            self._fill(q, root, self.ball_positions(vector / length))
            at_zero = self.model.jointPlacements[actuator].translation[2]
            q[:, self.model.joints[actuator].idx_q] = length[:, 0] - at_zero
        return q

    def closure_error(self) -> float:
        """Returns the largest distance between the ends of a loop [m], where the frames were put last."""
        gaps = np.array([self.data.oMf[tip].translation for tip in self.tips])
        gaps -= [self.data.oMf[anchor].translation for anchor in self.anchors]
        return float(np.sqrt((gaps**2).sum(axis=1).max()))

    def _fill(self, q: Array, joint: int, values: Array) -> None:
        start = self.model.joints[joint].idx_q
        q[:, start : start + values.shape[1]] = values

    def _joint(self, name: str) -> int:
        if not self.model.existJointName(name):
            raise EngineError(f"the loaded model has no joint {name}")
        return int(self.model.getJointId(name))

    def _frame(self, name: str) -> int:
        if not self.model.existFrame(name):
            raise EngineError(f"the loaded model has no frame {name}")
        return int(self.model.getFrameId(name))


class _UrdfTree(_Tree):
    """From the URDF and its sidecar: balls as three revolute joints, platform on a free-flyer."""

    platform_joint = "platform_joint"
    leg_joint = "leg{}_ball_x"
    legs = Legs.sps
    base_joint = "ball (three revolute joints)"
    way_out = "; the pose is regular, use pinocchio-ball"

    def __init__(self, mechanism: Mechanism) -> None:
        model = pin.buildModelFromXML(render_urdf(mechanism, self.legs))
        pairs = parse_closures(render_closures()).closed_loop
        closures = [self._closure(model, *pair) for pair in pairs]
        super().__init__(model, closures, pairs, mechanism.characteristic_length)

    @staticmethod
    def _closure(model: Any, tip: str, anchor: str) -> Any:
        ends = []
        for name in (tip, anchor):
            frame = model.frames[model.getFrameId(name)]
            ends += [frame.parentJoint, frame.placement]
        return pin.PointAnchorConstraintModel(model, *ends)

    def platform_positions(self, motion: Motion) -> Array:
        home = self.model.jointPlacements[self.platform]
        translation = (motion.position - home.translation) @ home.rotation
        return np.hstack([translation, _xyzw(motion)])

    def platform_rates(self, motion: Motion) -> tuple[Array, Array]:
        # A free-flyer's acceleration is spatial: the classical one less omega x v.
        to_body = np.swapaxes(motion.rotation, 1, 2)
        v, omega = _turn(to_body, motion.velocity), _turn(to_body, motion.angular_velocity)
        a = _turn(to_body, motion.acceleration) - np.cross(omega, v)
        epsilon = _turn(to_body, motion.angular_acceleration)
        return np.hstack([v, omega]), np.hstack([a, epsilon])

    def ball_positions(self, directions: Array) -> Array:
        x, y, z = directions.T
        # z axis of Rx(q1) Ry(q2); the third angle turns the leg about itself, which it does not feel.
        about_y = np.arctan2(x, np.hypot(y, z))
        if (np.hypot(y, z) < _GIMBAL_LOCK).any():
            sample = int(np.argmax(np.hypot(y, z) < _GIMBAL_LOCK))
            raise EngineError(
                f"gimbal lock of the URDF's {self.base_joint} at given sample {sample + 1}: a leg stands "
                f"across its home direction{self.way_out}"
            )
        return np.column_stack([np.arctan2(-y, z), about_y, np.zeros_like(x)])


class _UpsTree(_UrdfTree):
    """From the URDF with universal joints at the base."""

    leg_joint = "leg{}_universal_x"
    legs = Legs.ups
    base_joint = "universal joint"
    way_out = ""

    def ball_positions(self, directions: Array) -> Array:
        return super().ball_positions(directions)[:, :2]


class MjcfTree(_Tree):
    """From the MJCF with its `<connect>` closures: true balls, platform on three slides and a ball."""

    platform_joint = "Composite_platform_x"
    leg_joint = "leg{}_ball"

    def __init__(self, mechanism: Mechanism) -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "hexapod.xml"
            path.write_text(render_mjcf(mechanism), encoding="utf-8")
            model, closures, _welds = pin.buildModelAndConstraintsFromMJCF(str(path))
        super().__init__(model, closures, CLOSURES.closed_loop, mechanism.characteristic_length)

    def platform_positions(self, motion: Motion) -> Array:
        """Returns slides and quaternion (x, y, z, w); see `_Tree`."""
        home = self.model.jointPlacements[self.platform].translation
        return np.hstack([motion.position - home, _xyzw(motion)])

    def platform_rates(self, motion: Motion) -> tuple[Array, Array]:
        """Returns rates of slides and ball, which turns about axes of its body; see `_Tree`."""
        to_body = np.swapaxes(motion.rotation, 1, 2)
        omega = _turn(to_body, motion.angular_velocity)
        epsilon = _turn(to_body, motion.angular_acceleration)
        return np.hstack([motion.velocity, omega]), np.hstack([motion.acceleration, epsilon])

    def ball_positions(self, directions: Array) -> Array:
        """Returns the quaternions (x, y, z, w) of the shortest turns; see `_Tree`."""
        x, y, z = directions.T
        # Shortest turn from z, by its half angle; along z any axis will do: no turn, or half a turn.
        across = np.hypot(x, y)
        half, straight = np.arctan2(across, z) / 2, across == 0
        sine, divisor = np.sin(half), np.where(straight, 1.0, across)
        about_x, about_y = np.where(straight, 1.0, -y / divisor), x / divisor
        return np.column_stack([sine * about_x, sine * about_y, np.zeros_like(x), np.cos(half)])


def _xyzw(motion: Motion) -> Array:
    unit = motion.quaternion / np.linalg.norm(motion.quaternion, axis=1, keepdims=True)
    return np.roll(unit, -1, axis=1)


def _turn(rotation: Array, vectors: Array) -> Array:
    return np.einsum("nij,nj->ni", rotation, vectors)


class _PinocchioEngine:
    """RNEA of the open tree and the solve for actuator and closure forces."""

    formulation = "recursive Newton-Euler (RNEA) of the open tree"
    description: type[_UrdfTree] | type[MjcfTree]

    def __init__(self, mechanism: Mechanism) -> None:
        self.tree = self.description(mechanism)
        self.tree.model.gravity.linear = np.array(mechanism.gravity)

    @staticmethod
    def version() -> str:
        """Returns the version of Pinocchio."""
        return f"pin {pin.__version__}"

    def inverse_dynamics(self, motion: Motion, progress: Progress) -> EngineForces:
        """Returns the leg forces along a motion; see `Engine`."""
        tree = self.tree
        positions = tree.positions(motion)
        rates, accelerations = tree.platform_rates(motion)
        wrenches = _joint_wrenches(tree, motion)
        results = np.empty((len(motion), 8))
        external = pin.StdVec_Force([pin.Force.Zero() for _ in range(tree.model.njoints)])
        for k, q in enumerate(positions):
            external[tree.platform] = pin.Force(wrenches[k])
            v, a = joint_rates(tree, q, rates[k], accelerations[k])
            results[k] = self.sample(q, v, a, external)
            if (k + 1) % _PROGRESS_STEP == 0:
                progress(k + 1)
        return EngineForces(results[:, :6], results[:, 6], results[:, 7])

    def sample(self, q: Array, v: Array, a: Array, external: Any) -> Array:
        """Returns (8,) leg forces [N], closure residual and closure error at one sample.

        Args:
            q: (nq,) joint positions.
            v: (nv,) joint velocities.
            a: (nv,) joint accelerations.
            external: wrenches on the bodies, in joint frames.
        """
        return _close_loops(self.tree, pin.rnea(self.tree.model, self.tree.data, q, v, a, external))


class Pinocchio(_PinocchioEngine):
    """The URDF tree, balls as three revolute joints."""

    loops = "URDF tree and closure YAML; point constraints at the platform joints, [S, Jc^T] by QR"
    shares = "positions, rates, wrenches and loop-closing solve with pinocchio-ball; R with kane"
    description = _UrdfTree


class PinocchioUps(_PinocchioEngine):
    """The URDF tree with universal joints at the base."""

    loops = "URDF tree with universal joints; point constraints at the platform joints, [S, Jc^T] by QR"
    shares = Pinocchio.shares
    description = _UpsTree


class PinocchioBall(_PinocchioEngine):
    """The MJCF tree, true ball joints."""

    loops = "MJCF tree with <connect> read by Pinocchio, ball joints; [S, Jc^T] by QR"
    shares = "positions, rates, wrenches and loop-closing solve with pinocchio; R with kane"
    description = MjcfTree


def _joint_wrenches(tree: _Tree, motion: Motion) -> Array:
    """Returns (n, 6) external wrenches on the platform in its joint frame, moment about its origin."""
    to_body = np.swapaxes(motion.rotation, 1, 2)
    force, moment = _turn(to_body, motion.force), _turn(to_body, motion.moment)
    com = tree.model.inertias[tree.platform].lever
    return np.hstack([force, moment + np.cross(com, force)])


def joint_rates(tree: _Tree, q: Array, rate: Array, acceleration: Array) -> tuple[Array, Array]:
    """Returns v and a of all 30 coordinates, leg by leg from the motion of the platform joint.

    Of each leg, four unknown rates: its tip moves with the anchor (three equations) and the leg
    does not spin (one); on a universal joint three rates, and what spin there is follows from them.
    Accelerations follow from the same matrix, less what v alone causes.
    """
    model, data = tree.model, tree.data
    v, a = np.zeros(model.nv), np.zeros(model.nv)
    v[tree.platform_columns] = rate
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    rates = tree.leg_columns.shape[1]
    matrix, right = np.empty((6, rates, rates)), np.zeros((6, rates, 1))
    directions = np.empty((6, 3))
    for leg, columns in enumerate(tree.leg_columns):
        tip = pin.getFrameJacobian(model, data, tree.tips[leg], _WORLD)[:, columns]
        directions[leg] = data.oMi[tree.lowers[leg]].rotation[:, 2]
        matrix[leg, :3], matrix[leg, 3:] = tip[:3], tree.length * directions[leg] @ tip[3:]
        anchor = pin.getFrameJacobian(model, data, tree.anchors[leg], _WORLD)
        right[leg, :3, 0] = anchor[:3] @ v
    v[tree.leg_columns] = np.linalg.solve(matrix, right)[..., 0]

    a[tree.platform_columns] = acceleration
    pin.forwardKinematics(model, data, q, v, a)
    for leg in range(6):
        tip = pin.getFrameClassicalAcceleration(model, data, tree.tips[leg], _WORLD)
        anchor = pin.getFrameClassicalAcceleration(model, data, tree.anchors[leg], _WORLD)
        right[leg, :3, 0] = anchor.linear - tip.linear
        # The spin omega . s stays zero, and s turns with omega: epsilon . s = 0.
        right[leg, 3:, 0] = -tree.length * directions[leg] @ tip.angular
    a[tree.leg_columns] = np.linalg.solve(matrix, right)[..., 0]
    return v, a


def _close_loops(tree: _Tree, tau: Array) -> Array:
    """Solves [S, Jc^T] [F; lambda] = tau at the positions that `joint_rates` has set.

    Returns:
        (8,) six leg forces [N], the largest entry of the residual [N, N m], and the largest
        distance between the ends of a loop [m].
    """
    model, data = tree.model, tree.data
    for closure, closure_data in zip(tree.closures, tree.closure_data, strict=True):
        closure.calc(model, data, closure_data)  # without it the Jacobian is silently wrong
    jacobian = pin.getConstraintsJacobian(model, data, tree.closures, tree.closure_data)
    matrix = np.zeros((model.nv, 24))
    matrix[tree.actuated, np.arange(6)] = 1.0
    matrix[:, 6:] = jacobian.T
    _, solution, info = dgels(matrix / tree.units[:, None], tau / tree.units)
    if info != 0:
        raise EngineError(f"the loop-closing solve failed: dgels returned {info}")
    residual = np.abs(tau - matrix @ solution[:24]).max()
    return np.array([*solution[:6], residual, tree.closure_error()])
