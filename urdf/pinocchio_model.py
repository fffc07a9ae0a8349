"""The hexapod as a Pinocchio model with loop closures, built joint by joint.

Pinocchio's own joints rather than the exported texts: a URDF has no ball joint and its three revolute
joints lock, Pinocchio's reader of MJCF makes the platform a composite of three slides and a ball, and
neither brings the limits of the actuators. Names, and the home pose at coordinates zero, are those of the
exports:

    platform_joint    free-flyer    the platform, first in q and v
    leg<i>_ball       spherical     leg at its base joint, z along the leg at home
    leg<i>_actuator   prismatic     length less length at home
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from sixsps.arrays import Array
from sixsps.bodies import Link
from sixsps.limits import Limits
from sixsps.mechanism import Mechanism
from urdf.closures import CLOSURES, LEGS
from urdf.coordinates import Coordinates

_POINT = pin.ContactType.CONTACT_3D


def build_model(mechanism: Mechanism) -> Any:
    """Returns the open tree (`pinocchio.Model`, 37 coordinates, 30 velocities) with the mechanism's gravity.

    Frames `leg<i>_tip` and `platform_anchor<i>` coincide where a loop closes. Limits are those of the
    mechanism: lengths as position limits of the actuators, and forces and rates where it has them. All else
    has none, which to Pinocchio is the largest number either way.

    Raises:
        MechanismError: the mechanism is geometry alone.
    """
    model = pin.Model()
    model.name = mechanism.name
    model.gravity.linear = np.array(mechanism.gravity)
    coordinates = Coordinates(mechanism)
    platform = mechanism.platform
    home = pin.SE3(np.eye(3), coordinates.layout.home)
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), home, "platform_joint")
    _add_body(model, joint, "platform", pin.Inertia(platform.mass, np.array(platform.com), platform.inertia))
    for anchor, (_, name) in zip(mechanism.platform_anchors, CLOSURES.closed_loop, strict=True):
        _add_point(model, joint, name, anchor)
    for i in LEGS:
        _add_leg(model, i, coordinates)
    # Pinocchio's joints without limits come with the largest velocity as the least one too.
    model.lowerVelocityLimit[:] = -model.upperVelocityLimit
    model.referenceConfigurations["home"] = pin.neutral(model)
    return model


def build_closures(model: Any) -> Any:
    """Returns the six loop closures as a `StdVec_RigidConstraintModel`, tip first, then platform anchor.

    Of Pinocchio's two families of constraints this one serves both `getConstraintsJacobian` and
    `constraintDynamics`.
    """
    closures = pin.StdVec_RigidConstraintModel()
    for pair in CLOSURES.closed_loop:
        ends: list[Any] = []
        for name in pair:
            frame = model.frames[model.getFrameId(name)]
            ends += [frame.parentJoint, frame.placement]
        closures.append(pin.RigidConstraintModel(_POINT, model, *ends))
    return closures


def _add_leg(model: Any, i: int, coordinates: Coordinates) -> None:
    mechanism = coordinates.mechanism
    leg, place = mechanism.legs[i - 1], coordinates.layout.legs[i - 1]
    base = pin.SE3(coordinates.leg_frames[i - 1], np.array(mechanism.base_anchors[i - 1]))
    ball = model.addJoint(0, pin.JointModelSpherical(), base, f"leg{i}_ball")
    _add_body(model, ball, f"leg{i}_lower", _inertia(leg.lower, 1.0))
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, place.length]))
    slide = model.addJoint(ball, pin.JointModelPZ(), tip, f"leg{i}_actuator")
    strokes = [limit - place.length for limit in leg.length_limits]
    _set_limits(model, model.joints[slide], strokes, i, mechanism.limits)
    _add_body(model, slide, f"leg{i}_upper", _inertia(leg.upper, -1.0))
    _add_point(model, slide, f"leg{i}_tip", np.zeros(3))


def _set_limits(model: Any, joint: Any, strokes: list[float], i: int, limits: Limits) -> None:
    # One by one: the overload of `addJoint` that takes them all stores the upper velocity as the lower one.
    model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q] = strokes
    v = joint.idx_v
    if limits.force is not None:
        model.lowerEffortLimit[v], model.upperEffortLimit[v] = limits.force[i - 1]
    if limits.rate is not None:
        model.upperVelocityLimit[v] = limits.rate[i - 1]  # the lower one: see `build_model`


def _inertia(link: Link, sense: float) -> Any:
    moments = np.diag([link.transverse, link.transverse, link.axial])
    return pin.Inertia(link.mass, np.array([0.0, 0.0, sense * link.com]), moments)


def _add_body(model: Any, joint: int, name: str, inertia: Any) -> None:
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    frame = model.addJointFrame(joint)
    model.addBodyFrame(name, joint, pin.SE3.Identity(), int(frame))
    model.inertias[joint] = inertia  # to which the calls above add inertias of nothing, at a rounding each


def _add_point(model: Any, joint: int, name: str, point: Array) -> None:
    placement, parent = pin.SE3(np.eye(3), np.array(point)), model.getFrameId(model.names[joint])
    model.addFrame(pin.Frame(name, joint, parent, placement, pin.FrameType.OP_FRAME), False)
