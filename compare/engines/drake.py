"""Drake: the generated tree in a MultibodyPlant, its inverse dynamics and one linear solve.

Legs on balls come from the MJCF: Drake's parser makes a ball a BallRpyJoint, whose velocities are
the angular velocity in the parent frame, and of the platform's joints three prismatic ones and such
a ball. Legs on universal joints come from the URDF: of two hinges on one MJCF body the parser (1.51)
hangs the body's pose on the second, and the first turns about axes of the base.

The parser drops `<site>`, a `<connect>` between sites and a URDF's floating joint with a warning.
They are taken out beforehand, after which strict parsing holds that nothing else is lost. Added by
hand: the base of the URDF is welded to the world, and the ends of a loop are points, the origin of
the upper link and an anchor of the platform.

The tree is cut open at the platform joints. CalcInverseDynamics gives the generalised forces tau
that the open tree would need; six actuators and 18 closure forces have to supply them:
[S, Jc^T] [F; lambda] = tau, solved by least squares (QR). With balls these are 30 equations of rank
24, since the legs' spins are idle; with universal joints 24. What remains of the solve is the check
that the motion obeys the closures.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from importlib.metadata import version
from typing import Any

import numpy as np
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable, MultibodyForces
from scipy.linalg.lapack import dgels

from compare.engine import EngineForces, Progress
from sixsps.arrays import Array
from sixsps.errors import EngineError
from sixsps.legs import Legs
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from urdf import render_mjcf, render_urdf

_PROGRESS_STEP = 100
# Drake takes constraints on discrete plants only; no inverse dynamics depends on the step.
_TIME_STEP = 1e-3
_LEGS = range(1, 7)
_ORIGIN = np.zeros(3)
_V = JacobianWrtVariable.kV
# The cosine below which a universal joint counts as singular. The moment that spins the leg grows as its
# inverse cube: on wu2012, at this cosine, to leg forces of 60 times the load.
_SINGULAR_COSINE = 1e-2


class _Tree(ABC):
    """The open tree in Drake; subclasses know what its joints are.

    Closed, its plant has the six ball constraints too, which no inverse dynamics of Drake's heeds.

    Attributes:
        plant: finalized, its gravity the mechanism's.
        context: state of the plant.
        platform: its body.
        anchors: (3, 6) ends of the loops in the platform's frame [m].
        tips: frames of the upper links, whose origins are the other ends.
        length: what makes an angular velocity metric [m].
        units: (nv,) that length for the angular velocities in v, 1 for the others.
        actuated: (6,) columns of the actuators in v.
    """

    root_joint: str
    leg_joints: tuple[str, ...]
    platform_joints: tuple[str, ...]

    def __init__(self, plant: Any, mechanism: Mechanism, closed: bool) -> None:
        self.plant = plant
        self.anchors = np.asfortranarray(mechanism.platform_anchors.T)
        self.platform = plant.GetBodyByName("platform")
        self.platform_frame, self.world = self.platform.body_frame(), plant.world_frame()
        self.tips = [plant.GetBodyByName(f"leg{leg}_upper").body_frame() for leg in _LEGS]
        if closed:
            for tip, anchor in zip(self.tips, self.anchors.T, strict=True):
                plant.AddBallConstraint(tip.body(), _ORIGIN, self.platform, anchor)
        plant.mutable_gravity_field().set_gravity_vector(mechanism.gravity)
        plant.Finalize()
        self.context = plant.CreateDefaultContext()
        self.length = mechanism.characteristic_length
        self.units = np.ones(plant.num_velocities())
        for joint in map(plant.get_joint, plant.GetJointIndices()):
            if joint.can_rotate():  # of a free body, the first three
                self.units[joint.velocity_start() :][: min(3, joint.num_velocities())] = self.length
        self.actuated = self._columns("leg{}_actuator")[:, 0]
        self.leg_columns = np.hstack([self._columns(name) for name in (*self.leg_joints, "leg{}_actuator")])
        self.leg_rows = np.arange(6)[:, None]
        self.platform_columns = np.hstack([self._columns(name)[0] for name in self.platform_joints])

    @abstractmethod
    def platform_positions(self, motion: Motion) -> Array:
        """Returns the platform's part of q."""

    @abstractmethod
    def platform_rates(self, linear: Array, angular: Array) -> Array:
        """Returns the platform's part (n, 6) of v or its derivative, from those in world axes."""

    @abstractmethod
    def root_positions(self, leg: int, directions: Array) -> Array:
        """Returns the part of q that turns z of the leg's home frame to `directions` (n, 3)."""

    def positions(self, motion: Motion) -> Array:
        """Returns all joint positions q (n, nq), from where the platform puts the anchors."""
        q = np.empty((len(motion), self.plant.num_positions()))
        first = self._joint(self.platform_joints[0]).position_start()
        platform = self.platform_positions(motion)
        q[:, first : first + platform.shape[1]] = platform
        for leg, anchor in zip(_LEGS, self.anchors.T, strict=True):
            root, actuator = self._joint(self.root_joint, leg), self._joint("leg{}_actuator", leg)
            home = root.frame_on_parent().CalcPoseInWorld(self.context)
            joint = motion.position + motion.rotation @ anchor
            vector = (joint - home.translation()) @ home.rotation().matrix()
            length = np.linalg.norm(vector, axis=1, keepdims=True)
            turn = self.root_positions(leg, vector / length)
            first = root.position_start()
            q[:, first : first + turn.shape[1]] = turn
            at_zero = actuator.frame_on_parent().GetFixedPoseInBodyFrame().translation()[2]
            q[:, actuator.position_start()] = length[:, 0] - at_zero
        return q

    def _joint(self, name: str, leg: int = 0) -> Any:
        return self.plant.GetJointByName(name.format(leg))

    def _columns(self, name: str) -> Any:
        """Returns the columns in v of a joint of each leg (6, its velocities)."""
        joints = [self._joint(name, leg) for leg in _LEGS]
        return np.array([joint.velocity_start() + np.arange(joint.num_velocities()) for joint in joints])


class _BallTree(_Tree):
    """From the MJCF: legs on ball joints, platform on three sliders and a ball.

    A BallRpyJoint has space-fixed x-y-z angles, R = Rz Ry Rx, which lock at a pitch of a right angle.
    Only their rates do, and none is used: v holds the angular velocity, so that no pose is excluded.
    """

    root_joint = "leg{}_ball"
    leg_joints = ("leg{}_ball",)
    platform_joints = ("platform_x", "platform_y", "platform_z", "platform_ball")

    def __init__(self, mechanism: Mechanism, closed: bool) -> None:
        plant = _parse(render_mjcf(mechanism), "xml", _unknown_in_mjcf, closed)
        super().__init__(plant, mechanism, closed)
        # The parser hangs it on the last of the platform's joints, which is nothing to rely on.
        self._home = np.array(self.platform.EvalPoseInWorld(self.context).translation())

    def platform_positions(self, motion: Motion) -> Array:
        return np.hstack([motion.position - self._home, _angles(motion.rotation)])

    def platform_rates(self, linear: Array, angular: Array) -> Array:
        return np.hstack([linear, angular])

    def root_positions(self, leg: int, directions: Array) -> Array:  # noqa: ARG002  all balls are alike
        x, y, z = directions.T
        # z axis of Rz Ry; the roll turns the leg about itself, which it does not feel.
        return np.column_stack([np.zeros_like(x), np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)])


class _UniversalTree(_Tree):
    """From the URDF: legs on two revolute joints, platform a free body with a quaternion."""

    root_joint = "leg{}_universal_x"
    leg_joints = ("leg{}_universal_x", "leg{}_universal_y")
    platform_joints = ("platform",)

    def __init__(self, mechanism: Mechanism, closed: bool) -> None:
        plant = _parse(render_urdf(mechanism, Legs.ups), "urdf", _unknown_in_urdf, closed)
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))  # it would float
        super().__init__(plant, mechanism, closed)

    def platform_positions(self, motion: Motion) -> Array:
        unit = motion.quaternion / np.linalg.norm(motion.quaternion, axis=1, keepdims=True)
        return np.hstack([unit, motion.position])

    def platform_rates(self, linear: Array, angular: Array) -> Array:
        return np.hstack([angular, linear])

    def root_positions(self, leg: int, directions: Array) -> Array:
        x, y, z = directions.T
        across = np.hypot(y, z)
        if (across < _SINGULAR_COSINE).any():
            sample = int(np.argmax(across < _SINGULAR_COSINE))
            raise EngineError(
                f"singular universal joint at given sample {sample + 1}: leg {leg} stands along the joint's "
                "first axis, about which it then cannot turn; legs on spherical joints (sps) can"
            )
        # z axis of Rx(q1) Ry(q2).
        return np.column_stack([np.arctan2(-y, z), np.arctan2(x, across)])


# Of the MJCF: what the actuators can do, which is no part of inverse dynamics.
_UNKNOWN_ATTRIBUTES = ("actuatorfrclimited", "actuatorfrcrange")


def _parse(text: str, kind: str, unknown: Callable[[ET.Element], bool], discrete: bool) -> Any:
    """Returns the plant that Drake's parser makes of a description less what is unknown to it."""
    root = ET.fromstring(text)  # noqa: S314  written by this project
    # The mechanism may have any name, and some end the process: Drake aborts on "::".
    root.set({"xml": "model", "urdf": "name"}[kind], "hexapod")
    for parent in list(root.iter()):
        for child in [child for child in parent if unknown(child)]:
            parent.remove(child)
    for element in root.iter():
        for attribute in _UNKNOWN_ATTRIBUTES:
            element.attrib.pop(attribute, None)
    plant = MultibodyPlant(_TIME_STEP if discrete else 0.0)
    parser = Parser(plant)
    parser.SetStrictParsing()
    try:
        parser.AddModelsFromString(ET.tostring(root, encoding="unicode"), kind)
    except RuntimeError as error:
        raise EngineError(f"Drake does not read the mechanism: {' '.join(str(error).split())}") from error
    return plant


def _unknown_in_mjcf(element: ET.Element) -> bool:
    return element.tag in ("light", "site", "equality")


def _unknown_in_urdf(element: ET.Element) -> bool:
    return element.tag == "joint" and element.get("type") == "floating"


def _angles(rotation: Array) -> Array:
    """Returns (n, 3) roll, pitch and yaw of R = Rz Ry Rx, to rounding also where they lock."""
    yaw = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])
    pitch = np.arctan2(-rotation[:, 2, 0], np.hypot(rotation[:, 0, 0], rotation[:, 1, 0]))
    # From the second row of Rz^T R, so that the roll makes up for what the yaw left undetermined.
    sine, cosine = np.sin(yaw)[:, None], np.cos(yaw)[:, None]
    row = cosine * rotation[:, 1] - sine * rotation[:, 0]
    return np.column_stack([np.arctan2(-row[:, 2], row[:, 1]), pitch, yaw])


def tree_forces(tree: _Tree, motion: Motion) -> Iterator[tuple[Array, Array]]:
    """Yields what the open tree needs at each sample to follow the motion; its context is then set.

    Yields:
        (nv,) generalised forces tau, and the Jacobian (18, nv) of the gaps in the loops with respect to
        v in metric units, v * tree.units.
    """
    plant, context, platform = tree.plant, tree.context, tree.platform
    positions = tree.positions(motion)
    units = tree.units[tree.platform_columns]
    rates = tree.platform_rates(motion.velocity, motion.angular_velocity) * units
    accelerations = tree.platform_rates(motion.acceleration, motion.angular_acceleration) * units
    levers = motion.rotation @ platform.default_com()
    forces = MultibodyForces(plant)
    for k, q in enumerate(positions):
        plant.SetPositions(context, q)
        tips, anchors = _end_jacobians(tree)
        acceleration = _joint_motion(tree, tips, anchors, rates[k], accelerations[k])
        plant.CalcForceElementsContribution(context, forces)  # sets them, to gravity
        wrench = SpatialForce(motion.moment[k], motion.force[k])
        platform.AddInForce(context, levers[k], wrench, tree.world, forces)
        tau = plant.CalcInverseDynamics(context, acceleration, forces)
        yield tau, (tips[:, 3:] - anchors).reshape(18, -1)


def _end_jacobians(tree: _Tree) -> tuple[Array, Array]:
    """Returns the Jacobians of the loops' ends with respect to v in metric units.

    Returns:
        (6, 6, nv) of the tips, angular first; (6, 3, nv) of the anchors.
    """
    jacobian, world, at = tree.plant.CalcJacobianSpatialVelocity, tree.world, tree.context
    tips = [jacobian(at, _V, tip, _ORIGIN, world, world) for tip in tree.tips]
    jacobian = tree.plant.CalcJacobianTranslationalVelocity
    anchors = jacobian(at, _V, tree.platform_frame, tree.anchors, world, world)
    return np.array(tips) / tree.units, anchors.reshape(6, 3, -1) / tree.units


def _end_biases(tree: _Tree) -> tuple[Array, Array]:
    """Returns what v alone accelerates the loops' ends by: tips (6, 6), angular first; anchors (6, 3)."""
    bias, world, at = tree.plant.CalcBiasSpatialAcceleration, tree.world, tree.context
    tips = [bias(at, _V, tip, _ORIGIN, world, world).get_coeffs() for tip in tree.tips]
    bias = tree.plant.CalcBiasTranslationalAcceleration
    return np.array(tips), bias(at, _V, tree.platform_frame, tree.anchors, world, world).T


def _joint_motion(tree: _Tree, tips: Array, anchors: Array, rate: Array, acceleration: Array) -> Array:
    """Sets v of the tree and returns dv/dt, leg by leg from the motion of the platform.

    The unknown rates of a leg: its tip moves with the anchor (three equations) and, on a ball, it
    does not spin (one). Accelerations follow from the same matrix, less what v alone causes. Angular
    rates are metric throughout, or the solve would lose digits on a hexapod of another size.
    """
    platform = anchors[:, :, tree.platform_columns]
    legs = np.swapaxes(tips[tree.leg_rows, :, tree.leg_columns], 1, 2)
    unknowns = legs.shape[2]
    directions = legs[:, 3:, -1]  # a tip moves along the leg when its actuator does
    spins = tree.length * directions[:, None] @ legs[:, :3]
    matrix = np.concatenate([legs[:, 3:], spins], axis=1)[:, :unknowns]
    right = np.zeros((6, 4, 1))

    v = np.zeros(tips.shape[2])
    v[tree.platform_columns] = rate
    right[:, :3, 0] = platform @ rate
    v[tree.leg_columns] = np.linalg.solve(matrix, right[:, :unknowns])[..., 0]
    tree.plant.SetVelocities(tree.context, v / tree.units)

    a = np.zeros_like(v)
    a[tree.platform_columns] = acceleration
    tip_bias, anchor_bias = _end_biases(tree)
    right[:, :3, 0] = platform @ acceleration + anchor_bias - tip_bias[:, 3:]
    # The spin omega . s stays zero, and s turns with omega: epsilon . s = 0.
    right[:, 3, 0] = -tree.length * np.einsum("ij,ij->i", directions, tip_bias[:, :3])
    a[tree.leg_columns] = np.linalg.solve(matrix, right[:, :unknowns])[..., 0]
    return a / tree.units


def _close_loops(tree: _Tree, tau: Array, jacobian: Array) -> Array:
    """Solves [S, Jc^T] [F; lambda] = tau, the moments in it divided by the length.

    Returns:
        (8,) six leg forces [N], the largest entry of the residual [N, N m], and the largest
        distance between the ends of a loop at the positions of the tree's context [m].
    """
    plant, context = tree.plant, tree.context
    matrix = np.zeros((len(tau), 24))
    matrix[tree.actuated, np.arange(6)] = 1.0
    matrix[:, 6:] = jacobian.T
    metric = tau / tree.units
    _, solution, info = dgels(matrix, metric)
    if info != 0:
        raise EngineError(f"the loop-closing solve failed: dgels returned {info}")
    residual = np.abs(tree.units * (metric - matrix @ solution[:24])).max()
    ends = plant.CalcPointsPositions(context, tree.platform_frame, tree.anchors, tree.world)
    gaps = np.array([tip.CalcPoseInWorld(context).translation() for tip in tree.tips]) - ends.T
    return np.array([*solution[:6], residual, np.sqrt((gaps**2).sum(axis=1).max())])


class _DrakeEngine:
    """CalcInverseDynamics of the open tree and the solve for actuator and closure forces."""

    formulation = "recursive Newton-Euler (CalcInverseDynamics) of the open tree"
    tree: type[_BallTree] | type[_UniversalTree]
    closed = False

    def __init__(self, mechanism: Mechanism) -> None:
        self._tree = self.tree(mechanism, self.closed)

    @staticmethod
    def version() -> str:
        """Returns the version of Drake."""
        return f"drake {version('drake')}"

    def inverse_dynamics(self, motion: Motion, progress: Progress) -> EngineForces:
        """Returns the leg forces along a motion; see `Engine`."""
        results = np.empty((len(motion), 8))
        for k, (tau, jacobian) in enumerate(tree_forces(self._tree, motion)):
            results[k] = _close_loops(self._tree, tau, jacobian)
            if (k + 1) % _PROGRESS_STEP == 0 or k + 1 == len(motion):
                progress(k + 1)
        return EngineForces(results[:, :6], results[:, 6], results[:, 7])


class Drake(_DrakeEngine):
    """The MJCF tree, true ball joints."""

    loops = "MJCF tree, ball joints; point Jacobians at the platform joints, [S, Jc^T] by QR"
    shares = "R with kane; the MJCF with pinocchio-ball and mujoco"
    tree = _BallTree


class DrakeUps(_DrakeEngine):
    """The URDF tree, universal joints at the base: the legs spin."""

    loops = "URDF tree, universal joints; point Jacobians at the platform joints, [S, Jc^T] by QR"
    shares = "positions, rates, wrenches and loop-closing solve with drake; the URDF with pinocchio"
    tree = _UniversalTree
