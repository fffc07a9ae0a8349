"""Hexapod and robot as the one tree that they are, in Pinocchio: RNEA, then the loops are closed.

The robot's model is appended to the platform of the tree that `pinocchio-ball` uses. Its joints are
actuators of their own, so that their rows of the tree's generalised forces are the robot's torques; what is
left are the hexapod's 30 rows, to which closing the loops applies as without a robot. No base wrench
is formed anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg.lapack import dgels

from compare.engine import EngineForces, Progress
from compare.engines.pinocchio import MjcfTree, joint_rates
from compare.payload.ride import Carrier, Ride
from compare.payload.robot import RobotModel, fixed_model
from sixsps.arrays import Array
from sixsps.errors import EngineError
from sixsps.motion import Motion
from urdf.closures import CLOSURES

_PROGRESS_STEP = 100
_JOINT, _LINK = "payload/joint/", "payload/link/"
_PLATFORM = "platform"
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class TreeForces:
    """Forces of the whole tree: of the legs as an engine gives them, and the robot's joint torques (n, k)."""

    legs: EngineForces
    torques: Array


class WholeTree(MjcfTree):
    """The hexapod's tree with the robot's joints on the platform."""

    def __init__(self, carrier: Carrier) -> None:
        super().__init__(carrier.mechanism)
        robot = RobotModel(carrier.robot)
        mount = pin.SE3(np.array(carrier.mount.rotation), np.array(carrier.mount.position))
        platform = self.model.getFrameId(_PLATFORM)
        aboard = _renamed(fixed_model(robot))
        model = pin.appendModel(self.model, aboard, platform, mount)
        _check_whole(model, (self.model, aboard))
        model.gravity.linear = np.array(carrier.mechanism.gravity)
        # Joints have other numbers now: the closures are made again, between the same frames.
        closures = [self._closure(model, *pair) for pair in CLOSURES.closed_loop]
        super(MjcfTree, self).__init__(
            model, closures, CLOSURES.closed_loop, carrier.mechanism.characteristic_length
        )
        self.robot = robot
        joints = [model.joints[self._joint(_JOINT + name)] for name in robot.names]
        self.robot_columns = np.array([joint.idx_v for joint in joints], dtype=np.intp)
        self.robot_places = [slice(joint.idx_q, joint.idx_q + joint.nq) for joint in joints]
        self.hexapod_columns = np.setdiff1d(np.arange(model.nv), self.robot_columns)

    @staticmethod
    def _closure(model: pin.Model, tip: str, anchor: str) -> pin.PointAnchorConstraintModel:
        frames = [model.frames[model.getFrameId(name)] for name in (tip, anchor)]
        ends = [end for frame in frames for end in (frame.parentJoint, frame.placement)]
        return pin.PointAnchorConstraintModel(model, *ends)

    def states(self, ride: Ride) -> tuple[Array, Array, Array]:
        """Returns q (n, nq), and v and a (n, nv) with the hexapod's legs still at zero."""
        q = self.positions(ride.platform)
        angles = self.robot.joint_configurations(ride.joints.position)
        for place, values in zip(self.robot_places, angles, strict=True):
            q[:, place] = values
        v, a = np.zeros((2, len(ride), self.model.nv))
        v[:, self.platform_columns], a[:, self.platform_columns] = self.platform_rates(ride.platform)
        v[:, self.robot_columns], a[:, self.robot_columns] = ride.joints.velocity, ride.joints.acceleration
        return q, v, a


class PinocchioPayload:
    """Inverse dynamics of the whole tree, for the mechanism and the robot of a `Carrier`."""

    formulation = "RNEA of the one tree of hexapod and robot; the robot's joints are actuators"
    loops = "MJCF tree with the robot's URDF on its platform; [S, Jc^T] by QR over the hexapod's rows"
    shares = (
        "tree, rates and loop-closing solve with pinocchio-ball; RNEA, in another tree, with the base "
        "wrench that all others are given"
    )

    def __init__(self, carrier: Carrier) -> None:
        self.carrier = carrier
        self.tree = WholeTree(carrier)

    @staticmethod
    def version() -> str:
        """Returns the version of Pinocchio."""
        return f"pin {pin.__version__}"

    def inverse_dynamics(self, ride: Ride, progress: Progress) -> EngineForces:
        """Returns the leg forces along a ride; see `Engine`."""
        return self.tree_forces(ride, progress).legs

    def tree_forces(self, ride: Ride, progress: Progress = lambda _: None) -> TreeForces:
        """Returns leg forces and joint torques along a ride.

        Args:
            ride: n samples, on the mechanism and with the robot of the carrier.
            progress: called now and then.

        Raises:
            EngineError: the loop-closing solve failed.
        """
        tree = self.tree
        states = zip(*tree.states(ride), _on_platform(self.carrier, ride.platform), strict=True)
        results, torques = np.empty((len(ride), 8)), np.empty((len(ride), len(tree.robot_columns)))
        external = pin.StdVec_Force([pin.Force.Zero() for _ in range(tree.model.njoints)])
        for k, (q, v, a, wrench) in enumerate(states):
            external[tree.platform] = pin.Force(wrench)
            columns = tree.platform_columns
            legs_v, legs_a = joint_rates(tree, q, v[columns], a[columns])
            v[tree.leg_columns], a[tree.leg_columns] = legs_v[tree.leg_columns], legs_a[tree.leg_columns]
            tau = pin.rnea(tree.model, tree.data, q, v, a, external)
            torques[k] = tau[tree.robot_columns]
            results[k] = _close_loops(tree, tau)
            if (k + 1) % _PROGRESS_STEP == 0:
                progress(k + 1)
        return TreeForces(EngineForces(results[:, :6], results[:, 6], results[:, 7]), torques)


def _renamed(model: pin.Model) -> pin.Model:
    """Returns a robot's model in names of its own; URDF's links and joints may share theirs."""
    for joint in range(1, model.njoints):
        model.names[joint] = _JOINT + model.names[joint]
    for frame in list(model.frames)[1:]:
        frame.name = (_LINK if frame.type == pin.FrameType.BODY else _JOINT) + frame.name
    return model


def _check_whole(whole: pin.Model, parts: tuple[pin.Model, pin.Model]) -> None:
    """Raises EngineError unless a model has all joints and all mass of its parts."""
    joints = sum(part.njoints - 1 for part in parts)
    masses = [sum(inertia.mass for inertia in model.inertias) for model in (whole, *parts)]
    if whole.njoints - 1 != joints or abs(masses[0] - sum(masses[1:])) > _ROUNDING * sum(masses[1:]):
        raise EngineError("the tree of hexapod and robot has not all their joints and mass")


def _on_platform(carrier: Carrier, motion: Motion) -> Array:
    """Returns (n, 6) external wrenches on the platform, in its frame, moments about its origin."""
    to_body = np.swapaxes(motion.rotation, 1, 2)
    force, moment = (np.einsum("nij,nj->ni", to_body, part) for part in (motion.force, motion.moment))
    return np.hstack([force, moment + np.cross(carrier.mechanism.platform.com, force)])


def _close_loops(tree: WholeTree, tau: Array) -> Array:
    """Returns (8,) leg forces, residual and closure error from the tree's generalised forces (nv,).

    As in the engine without a robot; to the rows of the robot's joints no leg and no closure contributes.
    """
    model, data, rows = tree.model, tree.data, tree.hexapod_columns
    for closure, closure_data in zip(tree.closures, tree.closure_data, strict=True):
        closure.calc(model, data, closure_data)
    jacobian = pin.getConstraintsJacobian(model, data, tree.closures, tree.closure_data)
    actuators = np.zeros((model.nv, 6))
    actuators[tree.actuated, np.arange(6)] = 1.0
    matrix, given, units = np.hstack([actuators, jacobian.T])[rows], tau[rows], tree.units[rows]
    _, solution, info = dgels(matrix / units[:, None], given / units)
    if info != 0:
        raise EngineError(f"the loop-closing solve failed: dgels returned {info}")
    residual = np.abs(given - matrix @ solution[:24]).max()
    return np.array([*solution[:6], residual, tree.closure_error()])
