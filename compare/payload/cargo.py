"""What the command line puts on the platform, and what that makes of mechanism and motion."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Generator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from compare.inputs import Block, Motions, WholeMotion, load_motion, open_motions
from compare.payload.aboard import Aboard
from compare.payload.catalogue import find_robot
from compare.payload.joint_limits import told
from compare.payload.mount import Mount
from compare.payload.ride import Carrier, JointMotion, Ride
from compare.registry import load as load_engine
from sixsps.arrays import LARGEST, Array
from sixsps.errors import InputError, MechanismError, printable
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.payload import Payload, attached, shifted_wrench

if TYPE_CHECKING:
    from compare.payload.joints import Recording
    from compare.payload.robot import RobotModel


class Cargo(Protocol):
    """A payload that has been read and may be put on any mechanism.

    Attributes:
        is_robot: whether it is one, for which there are engines of the whole tree.
    """

    is_robot: bool

    def aboard(self, mechanism: Mechanism, motion: Motion) -> Aboard:
        """Returns the payload on the platform of `mechanism`, which moves as `motion` says.

        Raises:
            MechanismError: the mechanism is geometry alone.
            MotionError: the payload's own motion does not go with this one.
        """
        ...


class RigidCargo:
    """A rigid body; see `Cargo`."""

    is_robot = False

    def __init__(self, payload: Payload, source: str = "") -> None:
        self.payload, self.source = payload, source

    def aboard(self, mechanism: Mechanism, motion: Motion) -> Aboard:
        """Returns the body as part of the platform; see `Cargo`."""
        whole = self.attached(mechanism)
        return Aboard(whole, self.shifted(motion, mechanism, whole), self._facts())

    def attached(self, mechanism: Mechanism) -> Mechanism:
        """Returns the mechanism whose platform carries the body; see `sixsps.attached`."""
        mechanism.check_inertia()
        try:
            return attached(mechanism, self.payload)
        except MechanismError as error:  # of the sum, which stands in no file
            place = f"{error.place} of platform and payload"
            raise MechanismError(place, error.value, error.allowed, self.source) from None

    @staticmethod
    def shifted(motion: Motion, mechanism: Mechanism, whole: Mechanism) -> Motion:
        """Returns a motion, or a block of it, whose force acts at the common centre of mass."""
        return shifted_wrench(motion, mechanism.platform.com, whole.platform.com)

    def _facts(self) -> dict[str, Any]:
        payload = self.payload
        numbers = [payload.mass, payload.com.tolist(), payload.inertia.tolist()]
        digest = hashlib.sha256(json.dumps(numbers).encode()).hexdigest()
        return {
            "kind": "rigid body",
            "name": printable(payload.name),
            "sha256": digest,
            "mass_kg": payload.mass,
            "com_m": payload.com.tolist(),
        }


class RobotCargo:
    """A robot that moves or stands still; see `Cargo`."""

    is_robot = True

    def __init__(self, model: RobotModel, mount: Mount, recording: Recording | None = None) -> None:
        self.model, self.mount, self.recording = model, mount, recording

    def aboard(self, mechanism: Mechanism, motion: Motion) -> Aboard:
        """Returns the robot's wrench as part of the external one; see `Cargo`."""
        from compare.payload.robot import base_wrench

        mechanism.check_inertia()
        joints = self._joints(motion.time)
        ride = Ride(Carrier(mechanism, self.model.robot, self.mount), motion, joints)
        wrench = base_wrench(ride, self.model)
        if not max(np.abs(wrench.force).max(), np.abs(wrench.moment).max()) <= LARGEST:
            found, allowed = f"a wrench beyond {LARGEST:g} N or N m", "a robot and motions that exert less"
            raise MechanismError("payload", found, allowed, str(self.model.robot.urdf))
        loaded = replace(motion, force=motion.force + wrench.force, moment=motion.moment + wrench.moment)
        facts = self._facts(joints) | {
            "largest_force_N": float(np.linalg.norm(wrench.force, axis=1).max()),
            "largest_moment_Nm": float(np.linalg.norm(wrench.moment, axis=1).max()),
            "warnings": [*self.model.warnings, *joints.warnings, *self._limits_left(motion.time, joints)],
        }
        return Aboard(mechanism, loaded, facts, ride)

    def _joints(self, time: Array) -> JointMotion:
        if self.recording is not None:
            return self.recording.at(time)
        name, angles = self.model.standing
        rest = np.zeros((len(time), len(angles)))
        return JointMotion(rest + angles, rest, rest, f"standing still, {name} configuration")

    def _limits_left(self, time: Array, joints: JointMotion) -> tuple[str, ...]:
        return told(time, joints.position, self.model.limits, self.model.names, self.model.sliding)

    def _facts(self, joints: JointMotion) -> dict[str, Any]:
        samples = np.stack([joints.position, joints.velocity, joints.acceleration]).astype("<f8")
        return {
            "kind": "robot",
            "name": printable(self.model.robot.name),
            "sha256": self.model.sha256,
            "mass_kg": self.model.mass,
            "joints": len(self.model.names),
            "mount": {
                "position_m": self.mount.position.tolist(),
                "rotation": self.mount.rotation.tolist(),
            },
            "motion": {
                "name": printable(joints.name),
                "sha256": hashlib.sha256(samples.tobytes()).hexdigest(),
                "estimated": joints.estimated,
            },
        }


def open_cargo(payload: str | None, motion: Path | None = None, mount: str | None = None) -> Cargo | None:
    """Returns what the options --payload, --payload-motion and --payload-mount say, None where nothing.

    Args:
        payload: YAML file of a rigid body, URDF file or name of a robot.
        motion: CSV or Parquet file with the motion of the robot's joints; it stands still without.
        mount: where its base is on the platform; x,y,z or x,y,z,roll,pitch,yaw.

    Raises:
        InputError: a file cannot be read, or the options do not go together.
        EngineUnavailable: a robot without Pinocchio.
    """
    rigid = payload is None or Path(payload).suffix.lower() in (".yaml", ".yml")
    for option, value in (("--payload-motion", motion), ("--payload-mount", mount)):
        if rigid and value is not None:
            raise InputError(option, str(value), "only with a robot as --payload")
    if payload is None:
        return None
    if rigid:
        return RigidCargo(Payload.load(payload), payload)
    place = Mount.at() if mount is None else Mount.parse(mount)
    robot = find_robot(payload)
    load_engine("pinocchio")  # so that what is wrong with it is told as of an engine
    from compare.payload.robot import RobotModel

    model = RobotModel(robot)
    if motion is None:
        return RobotCargo(model, place)
    from compare.payload.joints import load

    return RobotCargo(model, place, load(motion, model.names, model.sliding, model.endless))


def open_motions_aboard(
    cargo: Cargo | None, name_or_path: str, mechanism: Mechanism, **options: Any
) -> tuple[Mechanism, Motions, list[str]]:
    """Returns mechanism and motion with the payload, and warnings.

    A long file is read on the way unless a robot rides.

    Args:
        cargo: the payload, if any.
        name_or_path: of the motion; see `open_motions`.
        mechanism: what it shall move.
        options: of `open_motions`.

    Raises:
        InputError: as `open_motions` and `Cargo.aboard`.
    """
    if cargo is None:
        return mechanism, open_motions(name_or_path, mechanism, **options), []
    if isinstance(cargo, RigidCargo):
        whole = cargo.attached(mechanism)
        motions = open_motions(name_or_path, mechanism, **options)
        return whole, _Shifted(motions, partial(cargo.shifted, mechanism=mechanism, whole=whole)), []
    aboard = cargo.aboard(mechanism, load_motion(name_or_path, mechanism, **options))
    warnings = [] if aboard.facts is None else [f"payload: {line}" for line in aboard.facts["warnings"]]
    return aboard.mechanism, WholeMotion(aboard.motion), warnings


class _Shifted:
    """A motion in blocks, each with the wrench at another point; see `Motions`."""

    def __init__(self, motions: Motions, shifted: partial[Motion]) -> None:
        self._motions, self._shifted = motions, shifted
        self.samples = motions.samples

    def blocks(self, size: int) -> Generator[Block, None, None]:
        """Yields the blocks; see `Motions`."""
        for block in self._motions.blocks(size):
            yield partial(self._block, block)

    def _block(self, block: Block) -> Motion:
        return self._shifted(block())
