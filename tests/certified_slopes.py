"""Derivatives of the leg forces to a dozen digits more than float64 has, from enclosures of the forces.

Central differences of `sixsps.certified`, which shares no formula with the symbolic model, in ball
arithmetic. States are rounded to a few bits, so that what is added to them is added exactly.
"""

import dataclasses
from contextlib import contextmanager

import flint
import numpy as np
from cases import random_motion
from differences import FIRST

from sixsps.certified import certified_inverse_dynamics
from sixsps.motion import Motion

BLOCKS = {
    "by_twist": ("velocity", "angular_velocity"),
    "by_acceleration": ("acceleration", "angular_acceleration"),
    "by_wrench": ("force", "moment"),
}


def coarse(values, bits):
    """Values rounded to multiples of 2^-bits."""
    return np.round(np.ldexp(values, bits)) / 2.0**bits


def coarse_motion(mechanism, seed, bits=14):
    """A random state whose entries have so few bits that small steps can be added exactly."""
    motion = random_motion(mechanism, seed, samples=1)
    arrays = {
        field.name: coarse(getattr(motion, field.name), bits)
        for field in dataclasses.fields(Motion)
        if field.name not in ("time", "name", "estimated", "changes")
    }
    return dataclasses.replace(motion, **arrays)


def slopes(mechanism, motion, exponent=-15, poses=True):
    """Returns by_pose, by_twist, by_acceleration and by_wrench (6, 6) of one coarse sample.

    Args:
        mechanism: taken as exact.
        motion: one sample, see `coarse_motion`.
        exponent: of the step, 2^exponent; by the pose, errors are of its eighth power.
        poses: whether by_pose is wanted.
    """
    step = 2.0**exponent
    found = {}
    if poses:
        found["by_pose"] = [_slope(mechanism, _moved(motion, axis), step) for axis in range(6)]
    for block, names in BLOCKS.items():
        directions = [_added(motion, name, axis) for name in names for axis in range(3)]
        found[block] = [_slope(mechanism, direction, step) for direction in directions]
    return {block: np.array(columns).T for block, columns in found.items()}


def translation_slopes(mechanism, motion, exponent):
    """Returns the first three columns of by_pose, (6, 3)."""
    step = 2.0**exponent
    return np.array([_slope(mechanism, _moved(motion, axis), step) for axis in range(3)]).T


def _slope(mechanism, at, step):
    multiples = [sign * k for k in FIRST for sign in (1, -1)]
    rows = [certified_inverse_dynamics(mechanism, at(k * step)).enclosures[0] for k in multiples]
    with _precise():
        weights = [flint.arb(flint.fmpq(*_ratio(FIRST[abs(k)]))) * (1 if k > 0 else -1) for k in multiples]
        sums = [sum(w * row[leg] for w, row in zip(weights, rows, strict=True)) for leg in range(6)]
        return [float((total / flint.arb(step)).mid()) for total in sums]


def _ratio(weight):
    """The fraction that a weight of `differences` stands for."""
    denominator = 840
    return round(weight * denominator), denominator


@contextmanager
def _precise():
    before, flint.ctx.prec = flint.ctx.prec, 256
    try:
        yield
    finally:
        flint.ctx.prec = before


def _added(motion, name, axis):
    def at(size):
        values = np.array(getattr(motion, name))
        values[:, axis] += size
        return dataclasses.replace(motion, **{name: values})

    return at


def _moved(motion, axis):
    """The pose moved along, or turned by Cayley's formula about, a world axis."""
    if axis < 3:
        return _added(motion, "position", axis)

    def at(size):
        w, *vector = motion.quaternion[0]
        turn = np.zeros(3)
        turn[axis - 3] = size / 2  # an angle of size + O(size^3), and (1, turn) need not be normalised
        product = [w - turn @ vector, *(vector + w * turn + np.cross(turn, vector))]
        return dataclasses.replace(motion, quaternion=[product])

    return at
