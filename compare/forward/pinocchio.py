"""Pinocchio: `constraintDynamics` on the tree and its loop closures, in the tree's own coordinates.

The tree of the MJCF has true balls and is cut open at the platform joints: 37 coordinates q, seven
quaternions among them, and 30 velocities v, of which six are the legs' idle spins. Forces go into
tau; the closures enter as 18 equations between accelerations, Jc a + Jc' v = 0, whose multipliers
are found together with a. Gaps of the loops are not drawn shut: an integrator keeps them as small
as its tolerance, and accelerations that depended on them would no longer be those of the hexapod.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from compare.engines.pinocchio import MjcfTree, joint_rates
from compare.forward.engine import ball_rates
from sixsps.arrays import Array
from sixsps.dynamics import State
from sixsps.errors import EngineError
from sixsps.mechanism import Mechanism
from sixsps.rotation import skew

_WXYZ = [3, 0, 1, 2]
_WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
# Of the mobility of the platform: the proximal term takes one part in about 1e10 of the closure forces
# off, and as much again of the rest at each iteration. After the second, rounding is left.
_PROXIMAL = 1e-10
_ITERATIONS = 4
# What the closure forces may leave of the accelerations that the ends of the loops have without them: the
# part of an acceleration that may be off in `recover`. Rounding leaves up to 5e-15 on random hexapods, and
# 3e-13 where legs weigh a thousand times as much as the platform.
_LEFT = 1e-9


class Pinocchio:
    """y = [q, v]: per leg a ball (x, y, z, w) and a slide, then the platform's slides and ball."""

    formulation = "constraintDynamics: M and the closures factorised together (sparse Cholesky), proximal"
    loops = (
        "MJCF tree with ball joints, 18 point closures between accelerations; their gaps are free to drift"
    )
    settings = (
        f"proximal mu {_PROXIMAL:g} / platform mass, {_ITERATIONS} iterations; no Baumgarte stabilisation"
    )
    steps_itself = False

    def __init__(self, mechanism: Mechanism) -> None:
        # Pinocchio computes about the world's origin: far from the hexapod that would cost digits.
        self._origin = mechanism.base_anchors.mean(axis=0)
        near = replace(mechanism, base_anchors=mechanism.base_anchors - self._origin)
        self.tree = tree = MjcfTree(near)
        model = tree.model
        model.gravity.linear = np.array(mechanism.gravity)
        self._closures, self._closure_data = (
            pin.StdVec_RigidConstraintModel(),
            pin.StdVec_RigidConstraintData(),
        )
        for tip, anchor in zip(tree.tips, tree.anchors, strict=True):
            ends = [part for end in (tip, anchor) for part in self._place(end)]
            self._closures.append(pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, *ends))
            self._closure_data.append(self._closures[-1].createData())
        self._data = model.createData()
        pin.initConstraintDynamics(model, self._data, self._closures, self._closure_data)
        # With an accuracy of zero it does all its iterations: its own measures are in newtons.
        self._proximal = pin.ProximalSettings(0.0, _PROXIMAL / mechanism.platform.mass, _ITERATIONS)
        self._find()

    def _place(self, frame: int) -> tuple[int, pin.SE3]:
        found = self.tree.model.frames[frame]
        return found.parentJoint, found.placement

    def _find(self) -> None:
        tree, joints = self.tree, self.tree.model.joints
        platform = joints[tree.platform]
        balls = [(joints[root].idx_q, joints[root].idx_v) for root in tree.roots]
        balls.append((platform.idx_q + 3, platform.idx_v + 3))
        slides = [(joints[actuator].idx_q, joints[actuator].idx_v) for actuator in tree.actuators]
        slides += [(platform.idx_q + axis, platform.idx_v + axis) for axis in range(3)]
        self._quaternions = np.array([np.arange(q, q + 4) for q, _ in balls])
        self._turning = np.array([np.arange(v, v + 3) for _, v in balls])
        self._positions, self._sliding = np.array(slides).T
        self._slides, self._ball = np.split(np.arange(platform.idx_v, platform.idx_v + 6), 2)
        self._home = tree.model.jointPlacements[tree.platform].translation
        self._arm = skew(tree.model.inertias[tree.platform].lever)
        self._gravity = float(np.linalg.norm(tree.model.gravity.linear))

    @staticmethod
    def version() -> str:
        """Returns the version of Pinocchio."""
        return f"pin {pin.__version__}"

    def initial(self, state: State) -> Array:
        """Returns y (67,), legs without spin; see `ForwardEngine`.

        Raises:
            EngineError: a leg has no length.
        """
        motion = replace(state, position=state.position - self._origin).unaccelerated()
        rate, acceleration = self.tree.platform_rates(motion)
        with np.errstate(invalid="ignore"):
            q = self.tree.positions(motion)[0]
        if not np.isfinite(q).all():
            raise EngineError("a leg has no length, and its ball no direction")
        v, _ = joint_rates(self.tree, q, rate[0], acceleration[0])
        return np.concatenate([q, v])

    def rates(self, y: Array, forces: Array, force: Array, moment: Array) -> Array:
        """Returns dy/dt (67,); see `ForwardEngine`."""
        q, v = self._split(y)
        rates = np.empty(len(q))
        rates[self._positions] = v[self._sliding]
        quaternions = y[self._quaternions][:, _WXYZ]
        rates[self._quaternions[:, _WXYZ]] = ball_rates(quaternions, v[self._turning])
        return np.concatenate([rates, self._accelerations(q, v, forces, force, moment)])

    def acceleration(self, y: Array, forces: Array, force: Array, moment: Array) -> Array:
        """Returns (6,) accelerations; see `ForwardEngine`."""
        q, v = self._split(y)
        a = self._accelerations(q, v, forces, force, moment)
        # The slides stand along world axes, and the ball's derivative is that of body components.
        return np.concatenate([a[self._slides], self._rotation(q) @ a[self._ball]])

    def platform(self, y: Array) -> State:
        """Returns the platform's state; see `ForwardEngine`."""
        q, v = self._split(y)
        position = self._origin + (self._home + q[self._positions[-3:]])
        quaternion = q[self._quaternions[-1]][_WXYZ]
        omega = self._rotation(q) @ v[self._ball]
        return State(position[None], quaternion[None], v[None, self._slides], omega[None])

    def closure_error(self, y: Array) -> float:
        """Returns the largest gap of a loop [m]; see `ForwardEngine`."""
        tree = self.tree
        pin.framesForwardKinematics(tree.model, tree.data, self._split(y)[0])
        return tree.closure_error()

    def _split(self, y: Array) -> tuple[Array, Array]:
        """Returns q with quaternions of unit length, and v."""
        q, v = np.split(y, [self.tree.model.nq])
        q = q.copy()
        q[self._quaternions] /= np.linalg.norm(q[self._quaternions], axis=1, keepdims=True)
        return q, v

    def _rotation(self, q: Array) -> Array:
        return np.asarray(pin.Quaternion(q[self._quaternions[-1]]).matrix())

    def _accelerations(self, q: Array, v: Array, forces: Array, force: Array, moment: Array) -> Array:
        """Returns (30,) accelerations of all coordinates."""
        model, to_body = self.tree.model, self._rotation(q).T
        tau = np.zeros(model.nv)
        tau[self.tree.actuated] = forces
        tau[self._slides] = force
        tau[self._ball] = to_body @ moment + self._arm @ (to_body @ force)
        closures = self._closures, self._closure_data
        a = pin.constraintDynamics(model, self._data, q, v, tau, *closures, self._proximal)
        if not np.isfinite(a).all():
            raise EngineError("constraintDynamics gave accelerations that are no finite numbers")
        self._check_closures(q, v, tau, a)
        return np.array(a)

    def _check_closures(self, q: Array, v: Array, tau: Array, a: Array) -> None:
        """Raises EngineError unless Jc a + Jc' v vanishes, compared with what it is without closures.

        What the proximal iterations say of themselves is no measure: they may stop anywhere.
        """
        apart = np.subtract(*self._end_accelerations(q, v, a))
        without = self._end_accelerations(q, v, pin.aba(self.tree.model, self.tree.data, q, v, tau))
        left, most = np.abs(apart).max(), np.abs(without).max() + self._gravity
        if not left <= _LEFT * most:
            raise EngineError(
                f"constraintDynamics left {left:.3g} m/s^2 between the ends of a loop; allowed: "
                f"{_LEFT:g} of the {most:.3g} m/s^2 that they have without closures"
            )

    def _end_accelerations(self, q: Array, v: Array, a: Array) -> Array:
        """Returns (2, 6, 3) accelerations of tips and anchors in world axes [m/s^2]."""
        model, data = self.tree.model, self.tree.data
        pin.forwardKinematics(model, data, q, v, a)
        frames = self.tree.tips, self.tree.anchors
        return np.array(
            [
                [pin.getFrameClassicalAcceleration(model, data, end, _WORLD).linear for end in ends]
                for ends in frames
            ]
        )
