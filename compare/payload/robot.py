"""The robot alone on a moving base, in Pinocchio: its joints, and the wrench that its base exerts."""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from compare.payload.catalogue import Robot
from compare.payload.description import described, names_in, parsed
from compare.payload.faithful import check_faithful
from compare.payload.mount import base_motion
from compare.payload.plausible import check_inertias
from compare.payload.ride import Ride
from sixsps.arrays import Array
from sixsps.errors import MechanismError
from sixsps.files import read_bytes

# Named configurations in which a robot stands, the first that it has; else all joints at zero.
STANDING = ("half_sitting", "standing", "default", "home")
_STDERR = 2
_LARGEST_FILE = 16 * 1024 * 1024


class RobotModel:
    """A robot as Pinocchio reads it, its root link on a free-flyer.

    Attributes:
        text: of its URDF file.
        sha256: of that file.
        description: what the text says by itself.
        model: joints 2, 3, ... are the robot's own.
        names: of the k joints, in the order of joint motions.
        sliding: (k,) bool, which of them slide.
        endless: (k,) bool, which of them turn without limits.
        limits: (k, 2) least and largest positions [rad, sliding joints m]; infinite where there are none.
        warnings: what a reader has to know of the file.

    Raises:
        MechanismError: the file is no URDF, a joint has more than one degree of freedom, no robot can be
            so, or Pinocchio reads another robot than the file describes.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot, source = robot, str(robot.urdf)
        self.text, self.sha256 = _text(robot)
        root = parsed(self.text, source)
        self.model = _read(self.text, source, _unused(names_in(root, source)))
        self._joints = list(self.model.joints)[2:]
        self.names = tuple(self.model.names)[2:]
        for name, joint in zip(self.names, self._joints, strict=True):
            if joint.nv != 1:
                found, allowed = f"{joint.nv} degrees of freedom", "joints of one degree of freedom"
                raise MechanismError(f"joint {name}", found, allowed, source)
        self.description = described(root, source)
        self.warnings = check_inertias(self.description)
        check_faithful(self.model, 1, self.description)
        joints = [self.description.joints[name] for name in self.names]
        self.sliding = np.array([joint.kind == "prismatic" for joint in joints], dtype=bool)
        self.endless = np.array([joint.kind == "continuous" for joint in joints], dtype=bool)
        self.limits = np.array([(joint.lower, joint.upper) for joint in joints]).reshape(-1, 2)

    @property
    def mass(self) -> float:
        """Mass of all links [kg]."""
        return float(sum(inertia.mass for inertia in self.model.inertias))

    @cached_property
    def standing(self) -> tuple[str, Array]:
        """Name and joint positions (k,) of the configuration in which it stands."""
        if self.robot.srdf is not None:
            with _silent():
                pin.loadReferenceConfigurations(self.model, str(self.robot.srdf))
        known = {entry.key(): entry.data() for entry in self.model.referenceConfigurations}
        name = next((name for name in STANDING if name in known), None)
        if name is None:
            return "neutral", self._angles(pin.neutral(self.model))
        return name, self._angles(known[name])

    def joint_configurations(self, positions: Array) -> list[Array]:
        """Returns what is each joint's in Pinocchio's q, (n, 1) or, of joints without limits, (n, 2).

        Args:
            positions: (n, k) of the joints.
        """
        return [
            position[:, None] if joint.nq == 1 else np.column_stack([np.cos(position), np.sin(position)])
            for joint, position in zip(self._joints, positions.T, strict=True)
        ]

    def _angles(self, q: Array) -> Array:
        parts = [np.asarray(q)[joint.idx_q : joint.idx_q + joint.nq] for joint in self._joints]
        return np.array([part[0] if len(part) == 1 else np.arctan2(part[1], part[0]) for part in parts])


@dataclass(frozen=True, eq=False)
class BaseWrench:
    """What a robot exerts on the platform, and on itself.

    Attributes:
        force: (n, 3) on the platform, world axes [N].
        moment: (n, 3) on the platform about its centre of mass, world axes [N m].
        torques: (n, k) of the robot's joints [N m], of sliding ones [N].
    """

    force: Array
    moment: Array
    torques: Array


def base_wrench(ride: Ride, robot: RobotModel) -> BaseWrench:
    """Returns the wrench of a robot on its platform: minus what moves its base, by RNEA.

    Args:
        ride: n samples.
        robot: the model of the ride's robot.
    """
    mechanism, mount = ride.carrier.mechanism, ride.carrier.mount
    base = base_motion(ride.platform, mount)
    to_body = np.swapaxes(base.rotation, 1, 2)
    velocity, omega = _turned(to_body, base.velocity), _turned(to_body, base.angular_velocity)
    # A free-flyer's acceleration is spatial: the classical one less omega x v.
    acceleration = _turned(to_body, base.acceleration) - np.cross(omega, velocity)
    epsilon = _turned(to_body, base.angular_acceleration)
    pose = np.hstack([base.position, Rotation.from_matrix(base.rotation).as_quat()])
    q = np.hstack([pose, *robot.joint_configurations(ride.joints.position)])
    v = np.hstack([velocity, omega, ride.joints.velocity])
    a = np.hstack([acceleration, epsilon, ride.joints.acceleration])
    robot.model.gravity.linear = np.array(mechanism.gravity)
    data = robot.model.createData()
    efforts = np.array([pin.rnea(robot.model, data, *state) for state in zip(q, v, a, strict=True)])
    force = -_turned(base.rotation, efforts[:, :3])
    arm = ride.platform.rotation @ (mount.position - mechanism.platform.com)
    moment = -_turned(base.rotation, efforts[:, 3:6]) + np.cross(arm, force)
    return BaseWrench(force, moment, efforts[:, 6:])


def fixed_model(robot: RobotModel) -> pin.Model:
    """Returns the model of a robot whose root link is fixed to the world."""
    model = pin.buildModelFromXML(robot.text)
    check_faithful(model, 0, robot.description)
    return model


def _text(robot: Robot) -> tuple[str, str]:
    """Returns the text of a robot's file and the file's SHA-256."""
    content = read_bytes(robot.urdf, "payload", MechanismError, _LARGEST_FILE)
    try:
        return content.decode("utf-8-sig"), hashlib.sha256(content).hexdigest()
    except UnicodeDecodeError as error:
        raise MechanismError("payload", str(error), "UTF-8 text", str(robot.urdf)) from None


def _unused(names: set[str]) -> str:
    """Returns a name for the free-flyer: a joint of its name would be welded to it without a word."""
    name = "free-flyer"
    while name in names:
        name += "'"
    return name


def _read(text: str, source: str, base: str) -> pin.Model:
    """Returns the model that a text describes, its root link on a free-flyer called `base`.

    Raises:
        MechanismError: it cannot be read, or not all of it.
    """
    with _silent() as said:
        try:
            model, problem = pin.buildModelFromXML(text, pin.JointModelFreeFlyer(), base), said()
        except Exception as error:  # the library has no class of its own for what it cannot read
            problem = said() or str(error)
    if problem:
        raise MechanismError("payload", problem, "a URDF file that Pinocchio reads as a whole", source)
    return model


@contextmanager
def _silent() -> Iterator[Callable[[], str]]:
    """Keeps from standard error what parsers write there; yields what gives the first error of it.

    The parser of URDF goes on without what it has complained of.
    """
    sys.stderr.flush()
    kept = os.dup(_STDERR)
    with tempfile.TemporaryFile() as file:

        def said() -> str:
            file.seek(0)
            lines = file.read().decode(errors="replace").splitlines()
            return next((" ".join(line.split()) for line in lines if line.startswith("Error")), "")

        os.dup2(file.fileno(), _STDERR)
        try:
            yield said
        finally:
            os.dup2(kept, _STDERR)
            os.close(kept)


def _turned(rotation: Array, vectors: Array) -> Array:
    return np.einsum("nij,nj->ni", rotation, vectors)
