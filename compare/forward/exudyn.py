"""Exudyn: a motion-driven run in redundant coordinates, whose multipliers are the leg forces.

The thirteen bodies of `compare.engines.exudyn` start from the first pose of a motion. From then on all
they are given is the six leg lengths and the external wrench as functions of time; Exudyn's implicit
integrator (generalised alpha, all 85 algebraic equations in positions: index 3) finds where the bodies
go, and the multipliers that keep the lengths.

With spectral radius 0 and driven positions that integrator takes accelerations from the last four
positions, (2 q_n - 5 q_n-1 + 4 q_n-2 - q_n-3) / h^2, which is q'' - 11/12 h^2 q'''' to leading order:
the forces' error falls with h^2, and three steps after the start nothing is left of how it was made.
So the forces come from the poses of the motion; its rates and accelerations set the start, and the
lengths between samples. A recorded motion, whose smoothed derivatives its noisy poses do not have, is
no motion that bodies can follow: `error_estimate` shows it.
The algorithm: Arnold and Bruels, Multibody System Dynamics 18 (2007) 185-202.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import exudyn as exu
import numpy as np
from scipy.interpolate import BPoly, CubicSpline
from scipy.spatial.transform import Rotation

from compare.engine import Progress
from compare.engines.exudyn import Bodies, coordinates, multipliers_for, one_line, platform_rates
from compare.engines.exudyn import Exudyn as InverseDynamics
from sixsps.arrays import Array
from sixsps.bodies import Leg, Link
from sixsps.dynamics import State
from sixsps.errors import EngineError
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

STEP = 2.5e-4
_FEWEST_STEPS = 100
# Three of the integrator, and what the first of them leave in the spline that is read between the
# steps: it rings, 3.7 times less each step.
_TRANSIENT_STEPS = 12
# Newton stops when its last change of the coordinates (root mean square) falls below this times the
# largest of them; rounding of the equations leaves less than a tenth of it.
_TOLERANCE = 1e-13
_TRUNCATION = 11 / 12
# A link's axial inertia over its transverse one: with less, the rounding of the loads turns the link
# about its axis by more than Newton's tolerance. A rod this thin is 800 times as long as its radius.
_THINNEST = 1e-5
_PROGRESS_STEPS = 200
# What Exudyn says when it calls this file and the user interrupts.
_INTERRUPTIONS = ("KeyboardInterrupt", "with an exception set")
_NO_CONVERGENCE = "the integrator gave up: Newton's method does not converge; the pose may be singular"
_Call = Callable[[Any, float], bool]
_Trouble = Callable[[State], str]
_BODY = 7


@dataclass(frozen=True, eq=False)
class DrivenRun:
    """What a motion-driven run gives, at the n >= 2 samples of the motion that it reached.

    Attributes:
        time: (n,) [s].
        forces: (n, 6) leg forces [N], positive in extension.
        position_error: (n,) distance of O1 from the motion [m].
        orientation_error: (n,) angle between the orientation and the motion's [rad].
        closure_error: (n,) largest gap of a joint at the nearest step, per axis [m].
        transient: time from the first sample on, during which the forces still depend on how the run
            was started [s].
        step: of the integrator [s].
        error_estimate: the integrator's error in the forces after the transient, about 11/12 of their
            largest second difference between steps; jumps of the wrench add to it; NaN without any [N].
        state: (n) simulated states of the platform.
        end: the motion's last sample, or the step that stopped the run [s].
        stopped: why the run stopped there; empty where it is complete.
    """

    time: Array
    forces: Array
    position_error: Array
    orientation_error: Array
    closure_error: Array
    transient: float
    step: float
    error_estimate: float
    state: State
    end: float
    stopped: str


@dataclass(frozen=True, eq=False)
class Driving:
    """What the bodies are given at every step.

    Attributes:
        time: (m,) evenly spaced, from the first sample on [s].
        lengths: (m, 6) [m].
        wrench: (m, 6) external force [N] and moment [N m] on the platform's centre of mass.
    """

    time: Array
    lengths: Array
    wrench: Array


@dataclass(frozen=True, eq=False)
class Log:
    """What the bodies did at every step that they reached.

    Attributes:
        forces: (m, 6) multipliers of the driven lengths, positive in extension [N].
        q: (m, 91) coordinates.
        v: (m, 7) velocities of the platform's coordinates.
        stopped: why there is no further step; empty where it is the last.
    """

    forces: Array
    q: Array
    v: Array
    stopped: str = ""


class DrivenBodies(Bodies):
    """The thirteen bodies, moving in time; good for one run.

    Attributes:
        joined: (48,) equations of the joints that are distances: all of the balls', and across of the
            sliding joints'.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        super().__init__(mechanism)
        self._com = mechanism.platform.com
        self.joined = np.concatenate([self.balls.ravel(), self.slides[:, :2].ravel()])

    def start(self, mechanism: Mechanism, motion: Motion) -> Log:
        """Sets the state that the run starts from, joints closed; returns it, and the forces there."""
        first = motion[:1]
        q = coordinates(mechanism, first)
        v, a = np.zeros(q.shape), np.zeros(q.shape)
        v[:, :_BODY], a[:, :_BODY] = platform_rates(mechanism, first, q[:, 3:_BODY])
        jacobian = self.move_legs(q[0], v[0], a[0])
        required = self.required(q[0], v[0], a[0], first.force[0], first.moment[0])
        forces = multipliers_for(jacobian.T, required)[0][self.lengths]
        initial = exu.ConfigurationType.Initial
        reference = self._data.GetODE2Coordinates(exu.ConfigurationType.Reference)
        self._data.SetODE2Coordinates(q[0] - reference, initial)
        self._data.SetODE2Coordinates_t(v[0], initial)
        self._data.SetODE2Coordinates_tt(a[0], initial)
        return Log(forces[None], q, v[:, :_BODY])

    def run(self, driving: Driving, start: Log, done: Callable[[float], None], trouble: _Trouble) -> Log:
        """Integrates over all steps, or up to the one that fails.

        Args:
            driving: lengths and wrench at m steps.
            start: the first of them.
            done: called with the time that is reached [s].
            trouble: says why to stop at a state of the platform, n = 1; empty to go on.
        """
        m, step = len(driving.time), float(driving.time[1])
        forces, q, v = (np.repeat(row, m, axis=0) for row in (start.forces, start.q, start.v))
        log = Log(forces, q, v)
        reached, stopped = 0, ""

        def before(_: Any, time: float) -> bool:
            self._drive(driving, round(time / step))
            return True

        def after(_: Any, time: float) -> bool:
            nonlocal reached, stopped
            k = round(time / step)
            if k > 0:  # before the first step no multipliers have been computed
                self._note(log, k)
                stopped = trouble(_platform(self._com, q[k : k + 1, :_BODY], v[k : k + 1]))
            if stopped:
                return False
            reached = k
            if reached % _PROGRESS_STEPS == 0:
                done(time)
            return True

        failure = self._integrated(_settings(driving.time, np.abs(start.q).max()), before, after)
        m = reached + 1
        return Log(forces[:m], q[:m], v[:m], stopped or failure)

    def _integrated(self, settings: Any, before: _Call, after: _Call) -> str:
        """Runs Exudyn's solver; returns why it did not get to the end, if it was not told to stop."""
        solver: Any = exu.MainSolverImplicitSecondOrder()
        self._system.SetPreStepUserFunction(before)
        self._system.SetPostStepUserFunction(after)
        try:
            return "" if solver.SolveSystem(self._system, settings) else _NO_CONVERGENCE
        except exu.ExudynError as error:
            return _failure(error)
        finally:
            # Exudyn would keep the bodies alive through them.
            self._system.SetPreStepUserFunction(0)
            self._system.SetPostStepUserFunction(0)

    def _drive(self, driving: Driving, k: int) -> None:
        for drive, length in zip(self._drives, driving.lengths[k], strict=True):
            self._system.SetObjectParameter(drive, "distance", length)
        self._system.SetLoadParameter(self._force, "loadVector", driving.wrench[k, :3])
        self._system.SetLoadParameter(self._moment, "loadVector", driving.wrench[k, 3:])

    def _note(self, log: Log, k: int) -> None:
        log.forces[k] = -self._data.GetAECoordinates()[self.lengths]
        log.q[k] = self._data.GetODE2CoordinatesTotal()
        log.v[k] = self._data.GetODE2Coordinates_t()[:_BODY]


class Exudyn:
    """Thirteen free bodies, driven by the leg lengths of a motion."""

    formulation = InverseDynamics.formulation
    loops = "ball, sliding and driven distance joints as algebraic equations, kept in positions (index 3)"
    settings = (
        f"generalised alpha, spectral radius 0, steps of {1e3 * STEP:g} ms or a little less; modified "
        f"Newton to {_TOLERANCE:g} of the coordinates; lengths between samples by a quintic spline; links' "
        f"axial inertia, on which no force depends, at least {_THINNEST:g} of the transverse"
    )

    def __init__(self, mechanism: Mechanism) -> None:
        legs = (Leg(_turnable(leg.lower), _turnable(leg.upper), leg.length_limits) for leg in mechanism.legs)
        self._mechanism = replace(mechanism, legs=tuple(legs))
        self._bodies = self._new_bodies()

    @staticmethod
    def version() -> str:
        """Returns the version of Exudyn."""
        return InverseDynamics.version()

    def driven(
        self, motion: Motion, progress: Progress, *, step: float = STEP, trouble: _Trouble = lambda _: ""
    ) -> DrivenRun:
        """Returns the run along a motion, up to where it has to stop.

        Args:
            motion: n >= 2 samples of a smooth motion.
            progress: called now and then with the number of samples that are done.
            step: largest step of the integrator [s]; it takes equal ones, 100 at least.
            trouble: says why to stop at a state of the platform, n = 1; empty to go on.

        Raises:
            EngineError: the run stopped before the second sample, or did not start.
        """
        if len(motion) < 2:
            raise EngineError(f"a driven run needs at least two samples, this motion has {len(motion)}")
        at = motion.time - motion.time[0]
        # Rounding in the quotient shall not add a step: steps would no longer fall on the samples.
        steps = max(math.ceil(at[-1] / step * (1 - 1e-9)), _FEWEST_STEPS)
        driving = drive(self._mechanism, motion, np.linspace(0.0, at[-1], steps + 1))
        try:
            bodies = self._new_bodies()
            start = bodies.start(self._mechanism, motion)
        except exu.ExudynError as error:
            raise EngineError(_failure(error)) from error
        log = bodies.run(driving, start, lambda time: progress(int(np.searchsorted(at, time))), trouble)
        run = self._read(motion, driving.time, log)
        progress(len(run.time))
        return run

    def _new_bodies(self) -> DrivenBodies:
        try:
            return DrivenBodies(self._mechanism)
        except exu.ExudynError as error:
            raise EngineError(f"exudyn does not accept the mechanism: {one_line(error)}") from error

    def _read(self, given: Motion, steps: Array, log: Log) -> DrivenRun:
        """Returns what the log (m) says of a motion, `steps` being the times that m were to be of."""
        time, step = steps[: len(log.q)], float(steps[1])
        since = given.time - given.time[0]
        # A step falls on a sample but for rounding.
        kept = int(np.count_nonzero(since <= time[-1] + 1e-6 * step))
        motion, at = given[:kept], since[:kept]
        if kept < 2:
            end = given.time[0] + len(time) * step
            raise EngineError(f"{log.stopped}, at t = {end:g} s already, before the second sample")
        columns = np.hstack([log.forces, log.q[:, :_BODY], log.v])
        read = CubicSpline(time, columns)(np.clip(at, 0.0, time[-1]))
        forces, q, v = np.split(read, [6, 6 + _BODY], axis=1)
        state = _platform(self._mechanism.platform.com, q, v)
        nearest = np.minimum(np.rint(at / step).astype(int), len(time) - 1)
        gaps = [np.abs(self._bodies.gaps(q)[self._bodies.joined]).max() for q in log.q[nearest]]
        return DrivenRun(
            time=motion.time,
            forces=forces,
            position_error=np.linalg.norm(state.position - motion.position, axis=1),
            orientation_error=_angles(state.quaternion, motion.quaternion),
            closure_error=np.array(gaps),
            transient=_TRANSIENT_STEPS * step,
            step=step,
            error_estimate=_error_estimate(log.forces),
            state=state,
            end=float(given.time[0] + len(time) * step if log.stopped else given.time[-1]),
            stopped=log.stopped,
        )


def _failure(error: Exception) -> str:
    """Returns what Exudyn says in one line; an interruption by the user goes on as such."""
    if any(sign in str(error) for sign in _INTERRUPTIONS):
        raise KeyboardInterrupt from error
    return f"exudyn fails on the motion: {one_line(error)}"


def _error_estimate(forces: Array) -> float:
    """Returns the integrator's error in forces (m, 6) at every step; NaN for too few of them."""
    bends = np.abs(np.diff(forces[_TRANSIENT_STEPS:], 2, axis=0))
    return _TRUNCATION * float(bends.max()) if len(bends) else math.nan


def _turnable(link: Link) -> Link:
    return replace(link, axial=max(link.axial, _THINNEST * link.transverse))


def drive(mechanism: Mechanism, motion: Motion, time: Array) -> Driving:
    """Returns what a motion of n >= 2 samples gives the bodies at other times.

    Lengths come from the spline of degree 5 through lengths, rates and accelerations at the samples,
    exact there; in between it is off by up to dt^6 / 46080 times their sixth time derivative, dt being
    the time between samples. The wrench comes from a cubic spline.

    Args:
        mechanism: geometry.
        motion: n samples.
        time: (m,) since the first sample, evenly spaced [s].
    """
    at = motion.time - motion.time[0]
    wrench = CubicSpline(at, np.hstack([motion.force, motion.moment]))
    return Driving(time, _quintic(at, *_lengths(mechanism, motion))(time), wrench(time))


def _quintic(x: Array, y: Array, dy: Array, ddy: Array) -> Any:
    """Returns the spline of degree 5 with these values, slopes and second derivatives (n, 6) at x."""
    h = np.diff(x)[:, None]
    first, last = slice(None, -1), slice(1, None)
    # Bernstein coefficients of each interval, from either end.
    coefficients = [
        y[first],
        y[first] + h / 5 * dy[first],
        y[first] + 2 * h / 5 * dy[first] + h**2 / 20 * ddy[first],
        y[last] - 2 * h / 5 * dy[last] + h**2 / 20 * ddy[last],
        y[last] - h / 5 * dy[last],
        y[last],
    ]
    return BPoly(np.array(coefficients), x)


def _lengths(mechanism: Mechanism, motion: Motion) -> tuple[Array, Array, Array]:
    """Returns the leg lengths and their first and second time derivatives, (n, 6) each."""
    omega, epsilon = motion.angular_velocity[:, None], motion.angular_acceleration[:, None]
    arms = mechanism.platform_anchors @ np.swapaxes(motion.rotation, 1, 2)
    S = (motion.position[:, None] - mechanism.base_anchors) + arms
    turning = np.cross(omega, arms)
    dS = motion.velocity[:, None] + turning
    ddS = motion.acceleration[:, None] + np.cross(epsilon, arms) + np.cross(omega, turning)
    length = np.linalg.norm(S, axis=-1)
    rate = np.sum(S * dS, axis=-1) / length
    return length, rate, (np.sum(S * ddS + dS**2, axis=-1) - rate**2) / length


def _platform(com: Array, q: Array, v: Array) -> State:
    """Returns the platform's states from its centre of mass (3,), coordinates and rates (n, 7)."""
    e, de = q[:, 3:], v[:, 3:]
    # [0, omega] = 2 e' e* as quaternions.
    omega = 2 * (e[:, :1] * de[:, 1:] - de[:, :1] * e[:, 1:] - np.cross(de[:, 1:], e[:, 1:]))
    lever = Rotation.from_quat(e, scalar_first=True).as_matrix() @ com
    return State(q[:, :3] - lever, e, v[:, :3] - np.cross(omega, lever), omega)


def _angles(first: Array, second: Array) -> Array:
    """Returns the angles (n,) between orientations given by quaternions (n, 4)."""
    a, b = (given / np.linalg.norm(given, axis=1, keepdims=True) for given in (first, second))
    chord = np.minimum(np.linalg.norm(a - b, axis=1), np.linalg.norm(a + b, axis=1))
    return 4 * np.arcsin(chord / 2)


def _settings(time: Array, size: float) -> Any:
    """Returns Exudyn's settings for equal steps; `size` is the largest coordinate [m]."""
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    integration = settings.timeIntegration
    integration.numberOfSteps = len(time) - 1
    integration.endTime = float(time[-1])
    # A smaller step would neither fall on the times of the driving nor let the start be forgotten.
    integration.adaptiveStep = False
    integration.generalizedAlpha.spectralRadius = 0.0
    # Exudyn's own take lengths for constant.
    integration.generalizedAlpha.computeInitialAccelerations = False
    newton = integration.newton
    newton.useModifiedNewton = True
    newton.residualMode = 1  # changes of coordinates: in forces, the tolerance would depend on the masses
    newton.absoluteTolerance = _TOLERANCE * size
    newton.relativeTolerance = np.finfo(float).eps
    return settings
