"""Lengths, Jacobians and poses for tests of forward kinematics, by numpy alone."""

import numpy as np
from scipy.spatial.transform import Rotation

UNIT_ROUNDOFF = np.finfo(float).eps / 2


def lengths_of(mechanism, position, rotation):
    """(6,) of one pose or (n, 6) of n."""
    arms = np.einsum("...ij,kj->...ki", rotation, mechanism.platform_anchors)
    return np.linalg.norm((np.asarray(position)[..., None, :] - mechanism.base_anchors) + arms, axis=-1)


def jacobian_of(mechanism, position, rotation):
    """Of one pose, angular columns over the characteristic length."""
    arms = mechanism.platform_anchors @ rotation.T
    legs = position + arms - mechanism.base_anchors
    directions = legs / np.linalg.norm(legs, axis=1)[:, None]
    return np.hstack([directions, np.cross(arms, directions) / mechanism.characteristic_length])


def determinant(mechanism, position, rotation):
    return np.linalg.det(jacobian_of(mechanism, position, rotation))


def moved(mechanism, position, rotation, step):
    """The pose that a step [dP, size * theta] leads to."""
    turn = Rotation.from_rotvec(step[3:] / mechanism.characteristic_length).as_matrix()
    return position + step[:3], turn @ rotation


def apart(mechanism, position, rotation, other_position, other_rotation):
    """Distance of two poses in characteristic lengths and radians; of n poses (n,)."""
    along = np.linalg.norm(np.subtract(position, other_position), axis=-1) / mechanism.characteristic_length
    about = np.linalg.norm(np.subtract(rotation, other_rotation), axis=(-2, -1)) / np.sqrt(2)
    return np.maximum(along, about)
