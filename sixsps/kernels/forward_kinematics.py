# mypy: allow-untyped-defs
"""Forward kinematics as machine code: the pose that the legs lead the platform to.

From a pose with lengths g_i to the wanted lengths l_i the platform is led along the straight line of squared
lengths g_i^2 + s (l_i^2 - g_i^2). The theorem of Newton and Kantorovich says how far at a time: with the
bound K of `pose_equations` and a Newton step of length eta <= 1 / (2 K), Newton's iteration converges to a
pose that is the only one within 1 / K, and no pose that near is singular (Deuflhard, Newton Methods for
Nonlinear Problems, 2004, section 2.1). As eta is linear in the squared lengths, that holds for all of them up
to there, if it does for the last: the pose that is found hangs together with the first by regular poses.
Where the whole way takes no more than one such step, this is plain Newton.

Along a trajectory the iteration starts from a parabola through the last poses, if that is so near to the
last one that the theorem holds for both lengths, and the same pose is found.
"""

from __future__ import annotations

import math

import numpy as np

from sixsps.arrays import LARGEST, Array
from sixsps.kernels.pose_equations import (
    REACH,
    curvature,
    distance,
    invert,
    move,
    newton_step,
    normalise,
    place,
    residuals,
    rounding,
    squared_extent,
)
from sixsps.machine_code import entry, part

# What becomes of a sample.
FOUND, IMPOSSIBLE, BLOCKED, FROM_SINGULAR, AT_SINGULAR, LIMIT, INVALID = range(7)
_REFUSED = 7
# Where a step is that short, over the radius of the theorem, the Jacobian may stay: every further step
# leaves about that part of the error.
_NEAR = 1e-2
# Of the coordinates squared: where a way ends at a singular pose with so little left, rounding is what ended
# it. Random double roots leave 1e-14 to 1e-10.
_ARRIVED = 1e-9
_TRIANGLE = 1e-14
# Of the norm: turning by a radian counts as so many root mean square distances of the platform's anchors
# from their middle. About the length of the legs would be best for translation, less for turning.
_WEIGHT = 2.5
_FILES = tuple(f"kernels/{name}.py" for name in ("forward_kinematics", "pose_equations"))
_GEOMETRY = "Tuple((f8[:, ::1], f8[:, ::1], f8[::1]))"
_POSES = "Tuple((f8[:, ::1], f8[:, ::1], u1[::1], i4[::1], f8[::1]))"
_FIXED = "Array(f8, 2, 'C', True)"

Geometry = tuple[Array, Array, Array]


def geometry_of(base: Array, platform: Array) -> Geometry:
    """Returns what the kernels take of a mechanism.

    Args:
        base: (6, 3) base anchors [m].
        platform: (6, 3) platform anchors [m].

    Returns:
        (6, 6) anchors as given; (6, 6) about their means and in the unit of the kernels; (9,) the means of
        the base and of the platform [m], the unit [m], which is a power of two, and in that unit w and the
        largest sum of distances of a leg's anchors from the means.
    """
    shift, offset = base.mean(axis=0), platform.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum((platform - offset) ** 2, axis=1))))
    unit = 2.0 ** round(math.log2(size))
    given = np.ascontiguousarray(np.hstack([base, platform]))
    anchors = np.ascontiguousarray(np.hstack([base - shift, platform - offset]) / unit)
    distances = np.linalg.norm(anchors.reshape(6, 2, 3), axis=2)
    largest = float(distances.sum(axis=1).max())
    return given, anchors, np.array([*shift, *offset, unit, _WEIGHT * size / unit, largest])


@part
def _memory():
    """Returns legs, inverse, rows, order, sums, residual, step, and five more (8,)."""
    many, one = np.empty((3, 6, 8)), np.empty((8, 8))
    return many[0], many[1], many[2], np.empty(6, np.int64), np.empty((7, 16)), one


@part
def _converge(anchors, frame, pose, wanted, away, memory, most):
    """Newton's iteration from a pose at which the theorem holds, to that with the wanted lengths (6,).

    Of the pose is known that it is no more than `away` from the one from which the way to these lengths
    starts; `most` bounds the number of iterations.

    Returns:
        FOUND, LIMIT, or _REFUSED where the theorem does not hold; and the number of iterations.
    """
    legs, inverse, rows, order, sums, vectors = memory
    residual, step = vectors[0], vectors[1]
    weight, largest = frame[7], frame[8]
    noise = rounding(largest, pose)
    place(anchors, pose, legs)
    count = 0
    while count < most:
        count += 1
        if not invert(legs, inverse, rows, order):
            return _REFUSED, count
        K, spread = curvature(legs, inverse, weight, sums)
        residuals(legs, wanted, residual)
        size = newton_step(inverse, residual, weight, step)
        if not (K * (size + spread * noise) <= REACH and K * away * (1 + K * away / 2) <= REACH):
            return _REFUSED, count
        away = 0.0
        contraction = K * size
        move(pose, step)
        place(anchors, pose, legs)
        while contraction <= _NEAR:
            # The error that is left is at most contraction * size, and so is what will be.
            if contraction * size <= spread * noise / 8:
                return FOUND, count
            if count == most:
                break
            count += 1
            residuals(legs, wanted, residual)
            before, size = size, newton_step(inverse, residual, weight, step)
            if size > before / 2:  # rounding
                return FOUND, count
            move(pose, step)
            place(anchors, pose, legs)
    return LIMIT, count


@part
def _follow(anchors, frame, pose, wanted, memory, most):
    """Leads a pose along the line of squared lengths, until the theorem holds for those wanted (6,).

    Returns:
        FOUND, BLOCKED, FROM_SINGULAR, AT_SINGULAR or LIMIT; and the number of iterations.
    """
    legs, inverse, rows, order, sums, vectors = memory
    residual, step, back, first, way = vectors[0], vectors[1], vectors[2], vectors[3], vectors[4]
    weight, largest = frame[7], frame[8]
    place(anchors, pose, legs)
    residuals(legs, wanted, way)
    for i in range(6):
        first[i] = legs[i, 6] / 2
    extent = squared_extent(largest, pose)
    done, count = 0.0, 0
    while count < most:
        count += 1
        if not invert(legs, inverse, rows, order):
            break
        K, spread = curvature(legs, inverse, weight, sums)
        for i in range(6):
            residual[i] = first[i] + done * way[i] - legs[i, 6] / 2
        room = REACH / K - newton_step(inverse, residual, weight, back) - spread * rounding(largest, pose)
        if not room > 0:
            break
        part_done = min(room / newton_step(inverse, way, weight, step), 1 - done)
        if not done + part_done > done:
            break
        for k in range(6):
            step[k] = part_done * step[k] + back[k]
        move(pose, step)
        if part_done == 1 - done:
            return FOUND, count
        done += part_done
        place(anchors, pose, legs)
    else:
        return LIMIT, count
    if done == 0:
        return FROM_SINGULAR, count
    left = 0.0
    for i in range(6):
        left = max(left, (1 - done) * abs(way[i]))
    near = left <= _ARRIVED * max(extent, squared_extent(largest, pose))
    return AT_SINGULAR if near else BLOCKED, count


@part
def _impossible(anchors, wanted):
    """Whether some two legs can never have their lengths at once, by the triangle inequality."""
    for i in range(6):
        for j in range(i):
            squares = np.zeros(2)
            for k in range(6):
                squares[k // 3] += (anchors[i, k] - anchors[j, k]) ** 2
            base, platform = math.sqrt(squares[0]), math.sqrt(squares[1])
            slack = _TRIANGLE * (base + platform + wanted[i] + wanted[j])
            if abs(wanted[i] - wanted[j]) > base + platform + slack:
                return True
            if wanted[i] + wanted[j] < abs(base - platform) - slack:
                return True
    return False


@part
def _lead(anchors, frame, pose, wanted, memory, most):
    """Leads a pose to that with the wanted lengths; returns what becomes of it, and the iterations."""
    first = memory[5][5]
    for i in range(7):
        first[i] = pose[i]
    reason, count = _converge(anchors, frame, pose, wanted, 0.0, memory, most)
    if reason != _REFUSED:
        return reason, count
    for i in range(7):
        pose[i] = first[i]
    if _impossible(anchors, wanted):
        return IMPOSSIBLE, count
    reason, more = _follow(anchors, frame, pose, wanted, memory, most - count)
    count += more
    if reason != FOUND:
        return reason, count
    reason, more = _converge(anchors, frame, pose, wanted, 0.0, memory, most - count)
    return AT_SINGULAR if reason == _REFUSED else reason, count + more


@part
def _turned(pose, x, y, z):
    """Returns R times a vector."""
    w, a, b, c = pose[3], pose[4], pose[5], pose[6]
    t0, t1, t2 = 2 * (b * z - c * y), 2 * (c * x - a * z), 2 * (a * y - b * x)
    return x + w * t0 + (b * t2 - c * t1), y + w * t1 + (c * t0 - a * t2), z + w * t2 + (a * t1 - b * t0)


@part
def _usable(given):
    """Whether the numbers of a pose are ones."""
    squares = 0.0
    for i in range(3, 7):
        squares += given[i] ** 2
    return abs(given[0]) + abs(given[1]) + abs(given[2]) <= LARGEST and 0 < squares <= LARGEST


@part
def _inwards(frame, given, pose):
    """Writes a pose as the kernels have it: position of the anchors' middle, from that of the base."""
    for i in range(3, 7):
        pose[i] = given[i]
    normalise(pose)
    turned = _turned(pose, frame[3], frame[4], frame[5])
    for i in range(3):
        pose[i] = ((given[i] - frame[i]) + turned[i]) / frame[6]


@part
def _outwards(frame, pose, given):
    """Writes a pose of the kernels as the mechanism has it."""
    turned = _turned(pose, frame[3], frame[4], frame[5])
    for i in range(3):
        given[i] = (frame[6] * pose[i] - turned[i]) + frame[i]
    for i in range(3, 7):
        given[i] = pose[i]


@part
def _predict(past, known, pose):
    """Writes what follows on so many of the last three poses, latest first."""
    for i in range(7):
        if known == 2:
            pose[i] = 2 * past[0, i] - past[1, i]
        else:
            pose[i] = 3 * (past[0, i] - past[1, i]) + past[2, i]
    normalise(pose)


@part
def _write(geometry, pose, lengths, reason, memory, poses, n):
    """Writes the result of a sample; its residual is that of the very pose that is written or left out."""
    given_anchors, _, frame = geometry
    legs, given = memory[0], memory[5][6]
    _outwards(frame, pose, given)
    place(given_anchors, given, legs)
    worst = 0.0
    for i in range(6):
        worst = max(worst, abs(math.sqrt(legs[i, 6]) - lengths[i]))
    positions, quaternions, reasons, _, residual = poses
    for i in range(3):
        positions[n, i] = given[i] if reason == FOUND else math.nan
    for i in range(4):
        quaternions[n, i] = given[3 + i] if reason == FOUND else math.nan
    reasons[n], residual[n] = reason, worst


@entry(f"void({_GEOMETRY}, {_FIXED}, f8[::1], {_POSES}, i8, i8, i8)", *_FILES)
def track(geometry, lengths, last, poses, start, stop, most):
    """Finds pose after pose, each from the last one that was found.

    Args:
        geometry: from `geometry_of`.
        lengths: (n, 6) [m].
        last: (7,) position [m] and quaternion that the first sample is reached from, and in the end those
            of the last sample that was found.
        poses: results: positions (n, 3) [m] and quaternions (n, 4), NaN where none was found; what becomes
            of a sample (n,), iterations (n,), residuals (n,) [m], how far the lengths of the last iterate
            are from those wanted.
        start: first sample.
        stop: sample after the last.
        most: iterations of a sample.
    """
    _, anchors, frame = geometry
    weight = frame[7]
    memory, past, pose, wanted = _memory(), np.empty((3, 7)), np.empty(7), np.empty(6)
    usable = _usable(last)
    _inwards(frame, last, past[0])
    known = 1
    for n in range(start, stop):
        reason, count = _REFUSED if usable else INVALID, 0
        for i in range(6):
            wanted[i] = lengths[n, i] / frame[6]
            if not 0 <= lengths[n, i] <= LARGEST:
                reason = INVALID
        if known > 1 and reason == _REFUSED:
            _predict(past, known, pose)
            away = distance(pose, past[0], weight)
            reason, count = _converge(anchors, frame, pose, wanted, away, memory, most)
        if reason == _REFUSED:
            for i in range(7):
                pose[i] = past[0, i]
            reason, more = _lead(anchors, frame, pose, wanted, memory, most - count)
            count += more
        _write(geometry, pose, lengths[n], reason, memory, poses, n)
        poses[3][n] = count
        known = min(known + 1, 3) if reason == FOUND else 1
        if reason == FOUND:
            for i in range(7):
                past[2, i], past[1, i], past[0, i] = past[1, i], past[0, i], pose[i]
    _outwards(frame, past[0], last)


@entry(f"boolean({_GEOMETRY}, f8[::1], f8[::1])", *_FILES)
def same(geometry, one, other):
    """Returns whether two poses with the same lengths, up to rounding, certainly are the same one.

    Args:
        geometry: from `geometry_of`.
        one: (7,) position [m] and quaternion.
        other: (7,).
    """
    _, anchors, frame = geometry
    legs, inverse, rows, order, sums, _ = _memory()
    here, there = np.empty(7), np.empty(7)
    _inwards(frame, one, here)
    _inwards(frame, other, there)
    place(anchors, here, legs)
    if not invert(legs, inverse, rows, order):
        return False
    K, _ = curvature(legs, inverse, frame[7], sums)
    return K * distance(here, there, frame[7]) <= REACH
