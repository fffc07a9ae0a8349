"""MuJoCo: the generated MJCF with its closures switched off, mj_inverse and one linear solve.

MuJoCo's own loop closures are soft: their forces follow from how far a motion misses the closures,
and a motion that keeps them gets none. They are therefore disabled. Of the open tree's 30
velocities (24 with universal joints) the platform's motion fixes those of the legs: each tip moves
with its anchor and, on a ball, the leg does not spin. mj_inverse gives the generalised forces tau
that the open tree would need; six actuators and 18 closure forces have to supply them:
[S, Jc^T] [F; lambda] = tau, solved by least squares (QR).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
from scipy.linalg.lapack import dgels

from compare.engine import EngineForces, Progress
from sixsps.arrays import Array
from sixsps.errors import EngineError
from sixsps.legs import Legs
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from urdf import render_mjcf
from urdf.closures import CLOSURES, LEGS

_PROGRESS_STEP = 100
# The cosine beyond which rounding shows, as in the URDF's revolute joints.
_GIMBAL_LOCK = 1e-2
_FIRST_JOINT = {Legs.sps: "leg{}_ball", Legs.ups: "leg{}_universal_x"}


class Tree:
    """The open tree in MuJoCo, in one state at a time.

    Attributes:
        model: the compiled MJCF, closures disabled.
        data: MuJoCo's state and results.
        platform: body of the platform.
        platform_positions: its three slides' and its ball's part of q.
        platform_columns: their part of the velocity.
        actuated: (6,) velocity indices of the actuators.
        units: (nv,) 1 for a coordinate along a line, the characteristic length for an angle [m].
        closure: (18, nv) Jacobian Jc of tips less anchors, leg by leg, at the state set last.
    """

    def __init__(self, mechanism: Mechanism, legs: Legs) -> None:
        self.legs = legs
        with quiet():
            try:
                self.model = mujoco.MjModel.from_xml_string(render_mjcf(mechanism, legs))
            except ValueError as error:
                reason = " ".join(str(error).removeprefix("Error: ").split())
                raise EngineError(f"MuJoCo refuses the mechanism: {reason}") from error
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EQUALITY
        self.data = mujoco.MjData(self.model)
        self._find()
        along = self.model.jnt_type[self.model.dof_jntid] == mujoco.mjtJoint.mjJNT_SLIDE
        self.units = np.where(along, 1.0, mechanism.characteristic_length)
        # Of the tips, then of the anchors: linear and angular rows, and their time derivatives.
        self._jacobians, self._drifts = np.zeros((2, 12, 2, 3, self.model.nv))

    def _find(self) -> None:
        model = self.model
        tips, anchors = zip(*CLOSURES.closed_loop, strict=True)
        self._sites = [model.site(name).id for name in (*tips, *anchors)]
        self._tips, self._anchors = np.split(np.array(self._sites), 2)
        self._uppers = model.site_bodyid[self._tips]
        self._lowers = model.body_parentid[self._uppers]
        self.platform = model.body("platform").id
        first, actuators = _FIRST_JOINT[self.legs], [model.joint(name) for name in CLOSURES.name_mot]
        roots = [model.joint(first.format(leg)) for leg in LEGS]
        pairs = list(zip(roots, actuators, strict=True))
        self._turning = [slice(root.qposadr[0], actuator.qposadr[0]) for root, actuator in pairs]
        self._lengthening = [actuator.qposadr[0] for actuator in actuators]
        self.actuated = np.array([actuator.dofadr[0] for actuator in actuators])
        self._columns = np.array([np.arange(root.dofadr[0], end.dofadr[0] + 1) for root, end in pairs])
        platform = model.joint("platform_x")
        self.platform_positions = slice(platform.qposadr[0], platform.qposadr[0] + 7)
        self.platform_columns = slice(platform.dofadr[0], platform.dofadr[0] + 6)

    def positions(self, motion: Motion) -> Array:
        """Returns all joint positions q (n, nq), from where the platform puts the anchors."""
        model = self.model
        q = np.empty((len(motion), model.nq))
        unit = motion.quaternion / np.linalg.norm(motion.quaternion, axis=1, keepdims=True)
        moved = motion.position - model.body_pos[self.platform]
        q[:, self.platform_positions] = np.hstack([moved, unit])
        home = np.empty(9)
        for leg, (lower, upper) in enumerate(zip(self._lowers, self._uppers, strict=True)):
            anchor = motion.rotation @ model.site_pos[self._anchors[leg]]
            mujoco.mju_quat2Mat(home, model.body_quat[lower])
            vector = (motion.position - model.body_pos[lower] + anchor) @ home.reshape(3, 3)
            turn = _ball if self.legs is Legs.sps else _universal
            q[:, self._turning[leg]] = turn(vector)
            q[:, self._lengthening[leg]] = np.linalg.norm(vector, axis=1) - model.body_pos[upper][2]
        return q

    def set_state(self, q: Array, rate: Array, acceleration: Array) -> None:
        """Sets positions, velocities and accelerations of all coordinates.

        The legs follow the platform: with rows N of what has to vanish, N v = 0 and N a + N' v = 0.

        Args:
            q: (nq,) joint positions.
            rate: (6,) velocity of the platform's joints, see `platform_rates`.
            acceleration: (6,) their acceleration.
        """
        model, data = self.model, self.data
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        for site, (linear, angular) in zip(self._sites, self._jacobians, strict=True):
            mujoco.mj_jacSite(model, data, linear, angular, site)
        N = self._rows(self._jacobians)
        self.closure = N[:, :3].reshape(18, -1)
        of_leg = np.take_along_axis(N, self._columns[:, None], axis=2)
        v, a = np.zeros((2, model.nv))
        v[self.platform_columns], a[self.platform_columns] = rate, acceleration
        v[self._columns] = np.linalg.solve(of_leg, -N @ v[:, None])[..., 0]
        data.qvel[:] = v
        mujoco.mj_comVel(model, data)  # without it mj_jacDot is silently wrong
        for site, (linear, angular) in zip(self._sites, self._drifts, strict=True):
            mujoco.mj_jacDot(model, data, linear, angular, data.site_xpos[site], model.site_bodyid[site])
        drift = self._rows(self._drifts) @ v[:, None]
        a[self._columns] = np.linalg.solve(of_leg, -N @ a[:, None] - drift)[..., 0]
        data.qacc[:] = a

    def _rows(self, jacobians: Array) -> Array:
        """Returns for each leg the rows of tip less anchor and, on a ball, of the spin omega . s.

        The spin's derivative has no part of s' = omega x s, so that N' takes the same s.

        Args:
            jacobians: (12, 2, 3, nv) of tips and anchors, or their time derivatives.
        """
        rows = jacobians[:6, 0] - jacobians[6:, 0]
        if self.legs is Legs.ups:
            return rows
        s = self.data.xmat[self._lowers].reshape(6, 3, 3)[:, None, :, 2]
        return np.concatenate([rows, s @ jacobians[:6, 1]], axis=1)

    def inverse(self, force: Array, moment: Array) -> Array:
        """Returns the (nv,) generalised forces that the state needs beyond the external wrench.

        Args:
            force: (3,) on the platform's centre of mass, world [N].
            moment: (3,) [N m].
        """
        model, data = self.model, self.data
        mujoco.mj_inverse(model, data)
        applied = np.zeros(model.nv)  # mj_inverse does not look at xfrc_applied
        mujoco.mj_applyFT(model, data, force, moment, data.xipos[self.platform], self.platform, applied)
        return data.qfrc_inverse - applied

    def closure_error(self) -> float:
        """Returns the largest distance between the ends of a loop [m]."""
        gaps = self.data.site_xpos[self._tips] - self.data.site_xpos[self._anchors]
        return float(np.sqrt((gaps**2).sum(axis=1).max()))


class _MujocoEngine:
    """mj_inverse of the open tree and the solve for actuator and closure forces."""

    formulation = "recursive Newton-Euler (mj_inverse) of the open tree"
    shares = "R with kane; all code of this file with the other legs"
    legs: Legs

    def __init__(self, mechanism: Mechanism) -> None:
        self.tree = Tree(mechanism, self.legs)

    @staticmethod
    def version() -> str:
        """Returns the version of MuJoCo."""
        return f"mujoco {mujoco.__version__}"

    def inverse_dynamics(self, motion: Motion, progress: Progress) -> EngineForces:
        """Returns the leg forces along a motion; see `Engine`."""
        tree = self.tree
        positions = tree.positions(motion)
        rates, accelerations = platform_rates(motion)
        results = np.empty((len(motion), 8))
        with quiet():
            for k, q in enumerate(positions):
                tree.set_state(q, rates[k], accelerations[k])
                tau = tree.inverse(motion.force[k], motion.moment[k])
                results[k] = [*self.close_loops(tau), tree.closure_error()]
                if (k + 1) % _PROGRESS_STEP == 0 or k + 1 == len(motion):
                    progress(k + 1)
        return EngineForces(results[:, :6], results[:, 6], results[:, 7])

    def close_loops(self, tau: Array) -> Array:
        """Solves [S, Jc^T] [F; lambda] = tau at the state of the tree.

        Returns:
            (7,) six leg forces [N] and the largest entry of the residual [N, N m].
        """
        tree = self.tree
        matrix = np.zeros((tree.model.nv, 24))
        matrix[tree.actuated, np.arange(6)] = 1.0
        matrix[:, 6:] = tree.closure.T
        # Moments over a length of the mechanism: its unit must not decide what rounding does.
        _, solution, info = dgels(matrix / tree.units[:, None], tau / tree.units)
        if info != 0:
            raise EngineError(f"the loop-closing solve failed: dgels returned {info}")
        residual = np.abs(tau - matrix @ solution[:24]).max()
        return np.array([*solution[:6], residual])


class Mujoco(_MujocoEngine):
    """Legs on balls, as the mechanism has them."""

    loops = "MJCF tree, ball joints; <connect> off, closure Jacobian from mj_jacSite; [S, Jc^T] by QR"
    legs = Legs.sps


class MujocoUps(_MujocoEngine):
    """Legs on universal joints, which make them spin a little."""

    loops = "MJCF tree, universal joints; <connect> off, closure Jacobian from mj_jacSite; [S, Jc^T] by QR"
    legs = Legs.ups


def platform_rates(motion: Motion) -> tuple[Array, Array]:
    """Returns velocity and acceleration (n, 6) of the platform's joints: three slides and a ball.

    The slides stand along world axes; a ball turns about axes of its body, and what it is given as
    acceleration is the derivative of those three components, the turned angular acceleration.
    """
    to_body = np.swapaxes(motion.rotation, 1, 2)
    omega = (to_body @ motion.angular_velocity[..., None])[..., 0]
    epsilon = (to_body @ motion.angular_acceleration[..., None])[..., 0]
    return np.hstack([motion.velocity, omega]), np.hstack([motion.acceleration, epsilon])


@contextmanager
def quiet() -> Iterator[None]:
    """Keeps MuJoCo from writing warnings to a file in the working directory.

    What it warns of here is that it could not divide by tiny inertias, which nothing here does.
    """
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _message: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def _ball(vectors: Array) -> Array:
    """Returns the quaternions (n, 4) of the shortest turn from z to the direction of `vectors`."""
    x, y, z = vectors.T
    across = np.hypot(x, y)
    half = np.arctan2(across, z) / 2
    # Along z any axis will do: no turn, or half a turn.
    straight = across == 0
    divisor = np.where(straight, 1.0, across)
    sine = np.sin(half)
    about_x, about_y = np.where(straight, 1.0, -y / divisor), x / divisor
    return np.column_stack([np.cos(half), sine * about_x, sine * about_y, np.zeros_like(x)])


def _universal(vectors: Array) -> Array:
    """Returns the angles (n, 2) about x, then y, that turn z to the direction of `vectors`."""
    x, y, z = vectors.T
    across = np.hypot(y, z)
    locked = across < _GIMBAL_LOCK * np.linalg.norm(vectors, axis=1)
    if locked.any():
        raise EngineError(
            f"gimbal lock of a universal joint at given sample {int(np.argmax(locked)) + 1}: a leg stands "
            "along its first axis"
        )
    return np.column_stack([np.arctan2(-y, z), np.arctan2(x, across)])
