# mypy: allow-untyped-defs
"""The equations of forward kinematics for Numba: leg lengths, their Jacobian, and how much they curve.

Written out by hand, and apart from the symbolic model. With u_i = P - A_i, c_i = R b_i and S_i = u_i + c_i
the equations are f_i = |S_i|^2 / 2 = l_i^2 / 2. A pose is moved by v = (dP, theta) to
(P + dP, exp([theta]x) R). There

    Df_i v = [S_i, c_i x S_i] v,
    D2f_i(v, v') = dP.dP' + dP.(E' c_i) + dP'.(E c_i) + u_i.(F c_i),  |E| <= |theta|, |F| <= |theta| |theta'|

wherever v has led to, E, E' and F being the same for all legs. In the norm max(|dP|, w |theta|), with the
entries j_i of a row of the inverse of Df at v = 0, the second derivative of that combination of the equations
is therefore nowhere within a distance d larger than

    |sum j_i| + 2 |sum j_i c_i| / w + (nuclear norm of sum j_i u_i c_i^T + d |sum j_i c_i|) / w^2.

A pose is an array (7,) of position and unit quaternion. Lengths are in a unit of about the platform's size;
anchors (6, 6) hold those of the base and of the platform, each relative to their mean; w is a few units.
"""

from __future__ import annotations

import math

from sixsps.machine_code import part

REACH = 0.45
"""The 1/2 of the theorem of Newton and Kantorovich, less room for the rounding of its quantities."""
# Of half a squared length, in squares of the largest coordinates.
_ROUNDING = 4 * 2.0**-53


@part
def place(anchors, pose, legs):
    """Writes S_i, c_i and |S_i|^2 of every leg into legs (6, 7)."""
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    xx, yy, zz = 2 * x * x, 2 * y * y, 2 * z * z
    xy, xz, yz = 2 * x * y, 2 * x * z, 2 * y * z
    wx, wy, wz = 2 * w * x, 2 * w * y, 2 * w * z
    for i in range(6):
        b0, b1, b2 = anchors[i, 3], anchors[i, 4], anchors[i, 5]
        c0 = (1 - yy - zz) * b0 + (xy - wz) * b1 + (xz + wy) * b2
        c1 = (xy + wz) * b0 + (1 - xx - zz) * b1 + (yz - wx) * b2
        c2 = (xz - wy) * b0 + (yz + wx) * b1 + (1 - xx - yy) * b2
        s0 = (pose[0] - anchors[i, 0]) + c0
        s1 = (pose[1] - anchors[i, 1]) + c1
        s2 = (pose[2] - anchors[i, 2]) + c2
        legs[i, 0], legs[i, 1], legs[i, 2] = s0, s1, s2
        legs[i, 3], legs[i, 4], legs[i, 5] = c0, c1, c2
        legs[i, 6] = s0 * s0 + s1 * s1 + s2 * s2


@part
def residuals(legs, wanted, out):
    """Writes half the differences of squared lengths, as products that cancel nothing."""
    for i in range(6):
        length = math.sqrt(legs[i, 6])
        out[i] = 0.5 * (wanted[i] - length) * (wanted[i] + length)


@part
def invert(legs, inverse, rows, order):
    """Writes the inverse of Df by Gauss and Jordan's elimination with partial pivoting.

    Args:
        legs: (6, 7) from `place`.
        inverse: (6, 6) a row a leg, a column a direction of motion.
        rows: (6, 6) to work in.
        order: (6,) to work in.

    Returns:
        Whether there is an inverse.
    """
    for i in range(6):
        s0, s1, s2 = legs[i, 0], legs[i, 1], legs[i, 2]
        c0, c1, c2 = legs[i, 3], legs[i, 4], legs[i, 5]
        rows[i, 0], rows[i, 1], rows[i, 2] = s0, s1, s2
        rows[i, 3], rows[i, 4], rows[i, 5] = c1 * s2 - c2 * s1, c2 * s0 - c0 * s2, c0 * s1 - c1 * s0
        order[i] = i
    for k in range(6):
        best = k
        for i in range(k + 1, 6):
            if abs(rows[i, k]) > abs(rows[best, k]):
                best = i
        if not abs(rows[best, k]) > 0:
            return False
        if best != k:
            for j in range(6):
                rows[k, j], rows[best, j] = rows[best, j], rows[k, j]
            order[k], order[best] = order[best], order[k]
        _eliminate(rows, k)
    for j in range(6):
        for k in range(6):
            inverse[order[j], k] = rows[k, j]
    return True


@part
def _eliminate(rows, k):
    pivot = 1 / rows[k, k]
    rows[k, k] = 1.0
    p0, p1, p2 = rows[k, 0] * pivot, rows[k, 1] * pivot, rows[k, 2] * pivot
    p3, p4, p5 = rows[k, 3] * pivot, rows[k, 4] * pivot, rows[k, 5] * pivot
    for i in range(6):
        factor = rows[i, k]
        rows[i, k] = 0.0
        rows[i, 0] -= factor * p0
        rows[i, 1] -= factor * p1
        rows[i, 2] -= factor * p2
        rows[i, 3] -= factor * p3
        rows[i, 4] -= factor * p4
        rows[i, 5] -= factor * p5
    rows[k, 0], rows[k, 1], rows[k, 2], rows[k, 3], rows[k, 4], rows[k, 5] = p0, p1, p2, p3, p4, p5


@part
def curvature(legs, inverse, weight, sums):
    """Returns the bound K of the inverse times the second derivative, and the norm of the inverse.

    Args:
        legs: (6, 7) from `place`.
        inverse: (6, 6) from `invert`.
        weight: w.
        sums: (7, 16) to work in: u_i c_i^T, c_i and 1 of every leg, and their sums.

    Returns:
        K, which holds within 2 REACH / K, and the longest step for residuals of at most 1.
    """
    for i in range(6):
        c0, c1, c2 = legs[i, 3], legs[i, 4], legs[i, 5]
        u0, u1, u2 = legs[i, 0] - c0, legs[i, 1] - c1, legs[i, 2] - c2
        sums[i, 0], sums[i, 1], sums[i, 2] = u0 * c0, u0 * c1, u0 * c2
        sums[i, 3], sums[i, 4], sums[i, 5] = u1 * c0, u1 * c1, u1 * c2
        sums[i, 6], sums[i, 7], sums[i, 8] = u2 * c0, u2 * c1, u2 * c2
        sums[i, 9], sums[i, 10], sums[i, 11], sums[i, 12] = c0, c1, c2, 1.0
        sums[i, 13], sums[i, 14], sums[i, 15] = 0.0, 0.0, 0.0  # whole vectors
    along = about = along_turned = about_turned = along_steps = about_steps = 0.0
    for k in range(6):
        j0, j1, j2 = inverse[0, k], inverse[1, k], inverse[2, k]
        j3, j4, j5 = inverse[3, k], inverse[4, k], inverse[5, k]
        for n in range(16):
            first = j0 * sums[0, n] + j1 * sums[1, n] + j2 * sums[2, n]
            sums[6, n] = first + j3 * sums[3, n] + j4 * sums[4, n] + j5 * sums[5, n]
        squares = 0.0
        for n in range(9):
            squares += sums[6, n] * sums[6, n]
        turned = math.sqrt(sums[6, 9] ** 2 + sums[6, 10] ** 2 + sums[6, 11] ** 2)
        # The nuclear norm of a 3 x 3 matrix is at most sqrt(3) times that of Frobenius.
        curved = abs(sums[6, 12]) + (2 * turned + math.sqrt(3 * squares) / weight) / weight
        steps = abs(j0) + abs(j1) + abs(j2) + abs(j3) + abs(j4) + abs(j5)
        if k < 3:
            along, along_turned = along + curved * curved, along_turned + turned * turned
            along_steps += steps * steps
        else:
            about, about_turned = about + curved * curved, about_turned + turned * turned
            about_steps += steps * steps
    here = max(math.sqrt(along), weight * math.sqrt(about))
    further = max(math.sqrt(along_turned), weight * math.sqrt(about_turned)) / weight**2
    longest = max(math.sqrt(along_steps), weight * math.sqrt(about_steps))
    return here + further * 2 * REACH / here, longest


@part
def norm(v, weight):
    """Returns max(|dP|, w |theta|)."""
    along = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    about = v[3] * v[3] + v[4] * v[4] + v[5] * v[5]
    return max(math.sqrt(along), weight * math.sqrt(about))


@part
def newton_step(inverse, right, weight, step):
    """Writes the step that changes half the squared lengths by `right`; returns its norm."""
    for k in range(6):
        total = 0.0
        for i in range(6):
            total += inverse[i, k] * right[i]
        step[k] = total
    return norm(step, weight)


@part
def move(pose, step):
    """Moves a pose by a step: (P + dP, exp([theta]x) R)."""
    for i in range(3):
        pose[i] += step[i]
    a, b, c = 0.5 * step[3], 0.5 * step[4], 0.5 * step[5]
    half = math.sqrt(a * a + b * b + c * c)
    ratio = math.sin(half) / half if half > 1e-5 else 1 - half * half / 6
    a, b, c, d = a * ratio, b * ratio, c * ratio, math.cos(half)
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    pose[3] = d * w - a * x - b * y - c * z
    pose[4] = d * x + a * w + b * z - c * y
    pose[5] = d * y + b * w + c * x - a * z
    pose[6] = d * z + c * w + a * y - b * x
    normalise(pose)


@part
def normalise(pose):
    """Gives a pose's quaternion unit length."""
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    ratio = 1 / math.sqrt(w * w + x * x + y * y + z * z)
    pose[3], pose[4], pose[5], pose[6] = w * ratio, x * ratio, y * ratio, z * ratio


@part
def distance(pose, other, weight):
    """Returns the norm of the step from one pose to another, or a little more."""
    along = about = same = 0.0
    for i in range(3, 7):
        same += pose[i] * other[i]
    sign = 1.0 if same >= 0 else -1.0
    for i in range(3):
        along += (pose[i] - other[i]) ** 2
    for i in range(3, 7):
        about += (pose[i] - sign * other[i]) ** 2
    # The chord is 2 sin(angle / 4), the angle at most pi: 4 arcsin(chord / 2) is at most 2.23 chords.
    return max(math.sqrt(along), 2.25 * weight * math.sqrt(about))


@part
def squared_extent(largest, pose):
    """Returns the square of the largest coordinates of a leg, `largest` being what anchors take of them."""
    return (math.sqrt(pose[0] ** 2 + pose[1] ** 2 + pose[2] ** 2) + largest) ** 2


@part
def rounding(largest, pose):
    """Returns what half the squared lengths may be off by."""
    return _ROUNDING * squared_extent(largest, pose)
