"""MuJoCo: `mj_forward` with the loops closed by its soft constraints, made as hard as it lets them be.

A constraint of MuJoCo gives way: J a = a_ref - R f, with a_ref = -(J' v + b J v + k r) from its gap r
and R = (1 - d) / d times an estimate of J M^-1 J^T. Where a motion keeps the loops closed, r = 0 and R f is
the error. `solimp` sets d, but MuJoCo cuts it at 0.9999, and 1e-4 of the closure forces' effect would
be missing: 5e-3 m/s^2 on the line of `wu2012`. The estimate comes from `body_invweight0`, which serves
for nothing else here; scaled down, it takes R with it. `solref` is the time in which gaps close: b and k
multiply their rounding, and the shorter it is, the more of that comes through.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from math import ceil
from typing import Any

import mujoco
import numpy as np
from numpy.linalg import LinAlgError

from compare.engines.mujoco import Tree, platform_rates, quiet
from compare.forward.engine import ForcesAt, Watch, ball_rates, unwatched
from sixsps.arrays import Array
from sixsps.dynamics import State
from sixsps.errors import EngineError
from sixsps.legs import Legs
from sixsps.mechanism import Mechanism

TIME_STEP = 2e-4
_WATCHED_STEPS = 5
_GAP_TIME = 2e-3
_IMPEDANCE = 0.9999
# At 1e-10 the constraints outweigh the inertia by what float64 can hold, and errors are 1e-4 m/s^2. The
# first of Newton's steps loses those digits, the second finds them again.
_SOFTNESS = 1e-7
_NEWTON_STEPS = 4
# What may be missing of the closure forces' effect; 1e-11 is as it should be. Machines of more than a
# thousand tons have more: MuJoCo's R is never less than 1e-15 per kg.
_LEFT = 1e-9
_OFF = (
    mujoco.mjtDisableBit.mjDSBL_WARMSTART,  # accelerations are to depend on the state alone
    mujoco.mjtDisableBit.mjDSBL_AUTORESET,  # a state that is no number any more is to stay one
)


class Mujoco:
    """y = [qpos, qvel]: per leg a ball (w, x, y, z) and a slide, then the platform's slides and ball."""

    formulation = "mj_forward: composite rigid bodies, constraint forces by Newton's method"
    loops = "MJCF tree with ball joints, <connect> as soft constraints"
    settings = (
        f'solref "{_GAP_TIME:g} 1", solimp "{_IMPEDANCE:g} {_IMPEDANCE:g}" (its limit), body_invweight0 x '
        f"{_SOFTNESS:g}, Newton solver with {_NEWTON_STEPS} iterations at tolerance 0, no warm start; "
        f"own steps: RK4 of up to {TIME_STEP:g} s"
    )
    steps_itself = True

    def __init__(self, mechanism: Mechanism) -> None:
        # Coordinates of the loops' ends are rounded, and the closures push against what that leaves.
        self._origin = mechanism.base_anchors.mean(axis=0)
        near = replace(mechanism, base_anchors=mechanism.base_anchors - self._origin)
        self.tree = Tree(near, Legs.sps)
        model = self.tree.model
        _harden(model)
        balls = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_BALL)
        self._quaternions = model.jnt_qposadr[balls, None] + np.arange(4)
        self._turning = model.jnt_dofadr[balls, None] + np.arange(3)
        slides = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE)
        self._positions, self._sliding = model.jnt_qposadr[slides], model.jnt_dofadr[slides]
        self._check_drift()

    def _check_drift(self) -> None:
        """Raises EngineError where a_ref lacks J' v, which MuJoCo has since 3.7 and its manual has not."""
        tree = self.tree
        home, still = self._origin + tree.model.body_pos[tree.platform], np.zeros((1, 3))
        self.initial(State(home[None], np.eye(1, 4), still, np.ones((1, 3))))
        on_the_closures = np.array(tree.data.qacc)
        mujoco.mj_fwdPosition(tree.model, tree.data)
        mujoco.mj_fwdVelocity(tree.model, tree.data)
        if not np.abs(self._apart(on_the_closures)).max() <= 1e-6 * np.abs(tree.data.efc_aref).max():
            raise EngineError(
                f"MuJoCo {mujoco.__version__} closes no loop that moves: J' v is not in its a_ref"
            )

    @staticmethod
    def version() -> str:
        """Returns the version of MuJoCo."""
        return f"mujoco {mujoco.__version__}"

    def initial(self, state: State) -> Array:
        """Returns y (67,), legs without spin; see `ForwardEngine`.

        Raises:
            EngineError: a leg has no length.
        """
        motion = replace(state, position=state.position - self._origin).unaccelerated()
        rate, acceleration = platform_rates(motion)
        try:
            self.tree.set_state(self.tree.positions(motion)[0], rate[0], acceleration[0])
        except LinAlgError as error:
            raise EngineError("a leg has no length, and its ball no direction") from error
        return np.concatenate([self.tree.data.qpos, self.tree.data.qvel])

    def rates(self, y: Array, forces: Array, force: Array, moment: Array) -> Array:
        """Returns dy/dt (67,); see `ForwardEngine`."""
        self._forward(y, forces, force, moment)
        q, v = np.split(y, [self.tree.model.nq])
        rates = np.empty(len(q))
        rates[self._positions] = v[self._sliding]
        # Not mju_derivQuat, which takes angular velocities in world axes: a ball's are in those of its body.
        rates[self._quaternions] = ball_rates(q[self._quaternions], v[self._turning])
        return np.concatenate([rates, self.tree.data.qacc])

    def acceleration(self, y: Array, forces: Array, force: Array, moment: Array) -> Array:
        """Returns (6,) accelerations; see `ForwardEngine`."""
        self._forward(y, forces, force, moment)
        linear, angular = np.split(self.tree.data.qacc[self.tree.platform_columns], 2)
        # The slides stand along world axes, and the ball's derivative is that of body components.
        return np.concatenate([linear, self._rotation(y) @ angular])

    def platform(self, y: Array) -> State:
        """Returns the platform's state; see `ForwardEngine`."""
        tree = self.tree
        q, v = np.split(y, [tree.model.nq])
        moved, quaternion = np.split(q[tree.platform_positions], [3])
        velocity, omega = np.split(v[tree.platform_columns], 2)
        position = self._origin + (tree.model.body_pos[tree.platform] + moved)
        turning = self._rotation(y) @ omega
        return State(position[None], quaternion[None], velocity[None], turning[None])

    def closure_error(self, y: Array) -> float:
        """Returns the largest gap of a loop [m]; see `ForwardEngine`."""
        self._set(self.tree.data, y)
        mujoco.mj_kinematics(self.tree.model, self.tree.data)
        return self.tree.closure_error()

    def run(self, y: Array, time_points: Array, forces_at: ForcesAt, watch: Watch = unwatched) -> Array:
        """Returns the states (k, m) at k times, by MuJoCo's own Runge-Kutta steps; see `SteppingEngine`.

        Args:
            y: (m,) state vector at the first time.
            time_points: (k,) increasing [s]; between two of them steps are equal, and at most `TIME_STEP`.
            forces_at: asked at each of the four stages of a step.
            watch: asked every five steps, and at the times.

        Raises:
            EngineError: the state is no number any more, or a quaternion has no length.
        """
        model = self.tree.model
        data = mujoco.MjData(model)  # of its own: `forces_at` may ask this engine for accelerations
        self._set(data, y)
        states = [y]
        with quiet(), self._controlled(data, forces_at) as failures:
            for start, end in pairwise(time_points):
                # Rounding must not add a step to a time that is a whole number of them.
                steps = max(1, ceil((end - start) / TIME_STEP * (1 - 1e-9)))
                data.time, model.opt.timestep = start, (end - start) / steps
                for k in range(1, steps + 1):
                    mujoco.mj_step(model, data)
                    if failures:
                        raise failures[0]
                    now = self._checked(data)
                    if k == steps:
                        states.append(now)
                    t = end if k == steps else data.time
                    if (k == steps or k % _WATCHED_STEPS == 0) and not watch(float(t), now):
                        return np.array(states)
        return np.array(states)

    def _checked(self, data: mujoco.MjData) -> Array:
        """Returns the state vector of data.

        Raises:
            EngineError: it is none any more.
        """
        y = np.concatenate([data.qpos, data.qvel])
        if not np.isfinite(y).all() or not np.linalg.norm(y[self._quaternions], axis=1).all():
            raise EngineError(f"MuJoCo's steps diverged at t = {data.time:g} s")
        return y

    def _set(self, data: mujoco.MjData, y: Array) -> None:
        data.qpos[:], data.qvel[:] = np.split(y, [self.tree.model.nq])
        mujoco.mj_normalizeQuat(self.tree.model, data.qpos)

    def _rotation(self, y: Array) -> Array:
        matrix, unit = np.empty(9), y[self._quaternions[-1]]
        mujoco.mju_quat2Mat(matrix, unit / np.linalg.norm(unit))
        return matrix.reshape(3, 3)

    def _push(self, data: mujoco.MjData, forces: Array, force: Array, moment: Array) -> None:
        data.qfrc_applied[self.tree.actuated] = forces  # from 1e10 N on, `ctrl` would silently be taken for 0
        data.xfrc_applied[self.tree.platform] = np.concatenate([force, moment])

    def _forward(self, y: Array, forces: Array, force: Array, moment: Array) -> None:
        """Computes the accelerations.

        Raises:
            EngineError: there are none, or the closures are softer than they are to be.
        """
        model, data = self.tree.model, self.tree.data
        self._set(data, y)
        self._push(data, forces, force, moment)
        with quiet():
            mujoco.mj_forward(model, data)
        if not np.isfinite(data.qacc).all():
            raise EngineError("MuJoCo gave accelerations that are no finite numbers")
        left, most = (np.abs(self._apart(a)).max() for a in (data.qacc, data.qacc_smooth))
        if not left <= _LEFT * (most + np.linalg.norm(model.opt.gravity)):
            raise EngineError(
                f"MuJoCo's closures give way by {left:.3g} m/s^2; allowed: {_LEFT:g} of the {most:.3g} m/s^2 "
                "without them"
            )

    def _apart(self, acceleration: Array) -> Array:
        """Returns (18,) what a closure's acceleration is off what it is to be [m/s^2]."""
        apart = np.empty(self.tree.data.nefc)
        mujoco.mj_mulJacVec(self.tree.model, self.tree.data, apart, acceleration)
        return apart - self.tree.data.efc_aref

    @contextmanager
    def _controlled(self, data: mujoco.MjData, forces_at: ForcesAt) -> Iterator[list[BaseException]]:
        """Lets MuJoCo ask for forces at each stage of a step.

        Yields:
            What was raised there: it must not pass through MuJoCo, which would not free its memory.
        """
        failures: list[BaseException] = []
        asking = False

        def control(_model: Any, _data: Any) -> None:
            nonlocal asking
            if asking or failures:
                return
            asking = True
            try:
                self._push(data, *forces_at(data.time, self._checked(data)))
            except BaseException as error:
                failures.append(error)
            asking = False

        before = mujoco.get_mjcb_control()
        mujoco.set_mjcb_control(control)
        try:
            yield failures
        finally:
            mujoco.set_mjcb_control(before)


def _harden(model: mujoco.MjModel) -> None:
    """Sets closures and solver."""
    option = model.opt
    option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    for flag in _OFF:
        option.disableflags |= flag
    model.eq_solref[:] = _GAP_TIME, 1.0
    model.eq_solimp[:, :2] = _IMPEDANCE
    model.body_invweight0[:] *= _SOFTNESS
    option.solver, option.iterations, option.tolerance = mujoco.mjtSolver.mjSOL_NEWTON, _NEWTON_STEPS, 0.0
    option.integrator, option.timestep = mujoco.mjtIntegrator.mjINT_RK4, TIME_STEP
