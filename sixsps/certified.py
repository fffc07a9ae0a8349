"""Inverse dynamics in ball arithmetic: leg forces with a proof of how far they are from the truth.

The float64 inputs are taken as exact and quaternions are normalised inside. Every operation encloses
its own rounding, so that the true force lies within the stated radius; precision is raised until that
radius is below 1e-20 of the largest leg force.

The derivation shares no formula with `kane.py`: it knows positions only. Along the motion a point is a
power series in time, under a virtual displacement a series in its size; accelerations and displacements
are coefficients. A body enters by the moments of its mass: a link by m, m e and I_t + m e^2 along its
axis, the platform by m, m r_m and tr(I)/2 E - I + m r_m r_m^T. D'Alembert's principle for mass points,

    sum_i F_i dl_i = integral dm (x'' - g) . dx - F_w . dx_m - m_w . dtheta,

in six virtual displacements of the platform is six equations for the six forces.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import arb, arb_mat, arb_series, ctx, fmpq, fmpq_mat

from sixsps.arrays import Array
from sixsps.errors import SixspsError
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

RADIUS = 1e-20
"""Every force is known to better than this, relative to the largest of its sample; where all of them
vanish, to the square of it, relative to the load."""

_FIRST_BITS, _MOST_BITS = 128, 16384
Vector = list[Any]
Matrix = list[Vector]


class CertificationError(SixspsError):
    """Forces that could be neither enclosed nor proven not to exist."""


@dataclass(frozen=True, eq=False)
class CertifiedForces:
    """Enclosures of the leg forces of a motion.

    Attributes:
        enclosures: a row of six balls a sample [N]; None where the pose is proven singular.
        bits: precision that the hardest sample took.
    """

    enclosures: list[Vector | None]
    bits: int

    @property
    def forces(self) -> Array:
        """(n, 6) the float64 nearest to each force [N]; NaN where the pose is singular."""
        rows = [[float(ball.mid()) for ball in row] if row else [np.nan] * 6 for row in self.enclosures]
        return np.array(rows).reshape(-1, 6)

    @property
    def singular(self) -> Array:
        """(n,) whether the pose is proven to be singular."""
        return np.array([row is None for row in self.enclosures], dtype=bool)

    def errors(self, forces: Array) -> Array:
        """Returns (n, 6) upper bounds of |forces - true forces| [N]; NaN at singular poses.

        Args:
            forces: (n, 6) [N], taken as exact.
        """
        bounds = np.full(forces.shape, np.nan)
        with _precision(self.bits):
            for k, row in enumerate(self.enclosures):
                if row is not None:
                    pairs = zip(forces[k].tolist(), row, strict=True)
                    nearest = [float(abs(arb(force) - ball).upper()) for force, ball in pairs]
                    bounds[k] = np.nextafter(nearest, np.inf)  # never below the bound in ball arithmetic
        return bounds


def certified_inverse_dynamics(mechanism: Mechanism, motion: Motion) -> CertifiedForces:
    """Encloses the leg forces along a motion.

    Args:
        mechanism: geometry and inertia, taken as exact.
        motion: n samples, taken as exact but for the length of the quaternions.

    Raises:
        CertificationError: a pose that is regular, but too close to singular to be told so.
    """
    rows, most = [], _FIRST_BITS
    for k in range(len(motion)):
        row, bits = _certify(mechanism, _Sample.of(motion, k))
        rows.append(row)
        most = max(most, bits)
    return CertifiedForces(rows, most)


@dataclass(frozen=True, eq=False)
class _Sample:
    """One sample of a motion as lists of floats."""

    position: list[float]
    quaternion: list[float]
    velocity: list[float]
    angular_velocity: list[float]
    acceleration: list[float]
    angular_acceleration: list[float]
    force: list[float]
    moment: list[float]

    @classmethod
    def of(cls, motion: Motion, k: int) -> _Sample:
        return cls(*(getattr(motion, name)[k].tolist() for name in cls.__dataclass_fields__))


def _certify(mechanism: Mechanism, sample: _Sample) -> tuple[Vector | None, int]:
    if _is_singular(mechanism, sample):
        return None, _FIRST_BITS
    bits, load = _FIRST_BITS, _load(mechanism, sample)
    while bits <= _MOST_BITS:
        with _precision(bits):
            try:
                matrix, right = _equations(mechanism, sample)
                solution = arb_mat(matrix).solve(arb_mat([[entry] for entry in right]))
            except ZeroDivisionError:  # not proven regular at this precision
                bits *= 2
                continue
            forces = [solution[i, 0] for i in range(6)]
            largest = max((abs(force).upper() for force in forces), key=float)
            # Forces that vanish have no relative error: then it is their load that counts, squared.
            known = max(RADIUS * largest, arb(RADIUS) ** 2 * load, key=float)
            if all(force.rad() <= known for force in forces):
                return forces, bits
        bits *= 2
    raise CertificationError(f"the forces could not be enclosed with {_MOST_BITS} bits")


def _load(mechanism: Mechanism, sample: _Sample) -> float:
    """Returns what the legs carry before anything of it cancels, roughly [N]."""
    mass = mechanism.platform.mass + float(mechanism.lower.mass.sum() + mechanism.upper.mass.sum())
    inertia = mass * (np.linalg.norm(mechanism.gravity) + np.linalg.norm(sample.acceleration))
    return float(inertia + np.linalg.norm(sample.force))


@contextmanager
def _precision(bits: int) -> Iterator[None]:
    before, cap = ctx.prec, ctx.cap
    ctx.prec, ctx.cap = bits, 3
    try:
        yield
    finally:
        ctx.prec, ctx.cap = before, cap


def _is_singular(mechanism: Mechanism, sample: _Sample) -> bool:
    """Decides by rational arithmetic, with leg vectors in place of their directions."""
    w, x, y, z = (_exact(value) for value in sample.quaternion)
    R = _rotation(w, x, y, z, w * w + x * x + y * y + z * z)
    rows = []
    for A, b in zip(mechanism.base_anchors.tolist(), mechanism.platform_anchors.tolist(), strict=True):
        c = _times(R, [_exact(value) for value in b])
        S = [_exact(p) + ci - _exact(a) for p, ci, a in zip(sample.position, c, A, strict=True)]
        rows.append([*S, *_cross(c, S)])
    return bool(fmpq_mat(rows).det() == 0)


def _exact(value: float) -> Any:
    return fmpq(*float(value).as_integer_ratio())


def _rotation(w: Any, x: Any, y: Any, z: Any, squared: Any) -> Matrix:
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return [[entry / squared for entry in row] for row in rows]


def _equations(mechanism: Mechanism, sample: _Sample) -> tuple[Matrix, Vector]:
    """Returns the matrix (6, 6) of dl_i and the right side (6,), a row for a virtual displacement."""
    w, x, y, z = (arb(value) for value in sample.quaternion)
    R = _rotation(w, x, y, z, w * w + x * x + y * y + z * z)
    moving = _in_time(sample, R)
    legs_in_time = [_leg(moving, *anchors) for anchors in _anchors(mechanism)]
    rows, right = [], []
    for k in range(6):
        displaced = _displaced(sample, R, k)
        legs = [_leg(displaced, *anchors) for anchors in _anchors(mechanism)]
        rows.append([leg.length[1] for leg in legs])
        work = _platform_work(mechanism, sample, moving, displaced, k)
        for index, (in_time, virtual) in enumerate(zip(legs_in_time, legs, strict=True)):
            work += _leg_work(mechanism, index, in_time, virtual)
        right.append(work)
    return rows, right


@dataclass(frozen=True, eq=False)
class _Pose:
    """Position (3,) and rotation (3, 3) of the platform as power series."""

    position: Vector
    rotation: Matrix


@dataclass(frozen=True, eq=False)
class _Leg:
    """Platform joint (3,), direction (3,) and length of a leg as power series."""

    joint: Vector
    direction: Vector
    length: Any


def _anchors(mechanism: Mechanism) -> Iterator[tuple[list[float], list[float]]]:
    return zip(mechanism.base_anchors.tolist(), mechanism.platform_anchors.tolist(), strict=True)


def _in_time(sample: _Sample, R: Matrix) -> _Pose:
    """P + v t + a t^2 / 2, and R from R' = [omega]x R with omega = omega_0 + epsilon t."""
    position = [
        arb_series([arb(p), arb(v), arb(a) / 2])
        for p, v, a in zip(sample.position, sample.velocity, sample.acceleration, strict=True)
    ]
    turn = _skew([arb(value) for value in sample.angular_velocity])
    twice = _product(turn, turn)
    change = _skew([arb(value) for value in sample.angular_acceleration])
    second = [[(change[i][j] + twice[i][j]) / 2 for j in range(3)] for i in range(3)]
    coefficients = [R, _product(turn, R), _product(second, R)]
    return _Pose(position, _series(coefficients))


def _displaced(sample: _Sample, R: Matrix, k: int) -> _Pose:
    """The platform moved along (k < 3) or turned about (k >= 3) a world axis."""
    unit = [arb(int(i == k % 3)) for i in range(3)]
    nothing = [arb(0)] * 3
    along, about = (unit, nothing) if k < 3 else (nothing, unit)
    position = [arb_series([arb(p), d]) for p, d in zip(sample.position, along, strict=True)]
    return _Pose(position, _series([R, _product(_skew(about), R)]))


def _leg(pose: _Pose, A: list[float], b: list[float]) -> _Leg:
    c = _times(pose.rotation, [arb(value) for value in b])
    joint = [p + ci for p, ci in zip(pose.position, c, strict=True)]
    S = [value - arb(a) for value, a in zip(joint, A, strict=True)]
    length = (S[0] * S[0] + S[1] * S[1] + S[2] * S[2]).sqrt()
    return _Leg(joint, [value / length for value in S], length)


def _leg_work(mechanism: Mechanism, index: int, in_time: _Leg, virtual: _Leg) -> Any:
    """Both links: x = A + r s and x = B - r s, integrated over r by the moments of the mass."""
    g = [arb(value) for value in mechanism.gravity.tolist()]
    lower, upper = mechanism.legs[index].lower, mechanism.legs[index].upper
    dds, ds = [2 * value[2] for value in in_time.direction], [value[1] for value in virtual.direction]
    lift = [2 * value[2] - gi for value, gi in zip(in_time.joint, g, strict=True)]  # B'' - g
    dB = [value[1] for value in virtual.joint]
    m, e = arb(lower.mass), arb(lower.com)
    work = (arb(lower.transverse) + m * e * e) * _dot(dds, ds) - m * e * _dot(g, ds)
    m, e = arb(upper.mass), arb(upper.com)
    work += m * _dot(lift, dB) - m * e * (_dot(lift, ds) + _dot(dds, dB))
    return work + (arb(upper.transverse) + m * e * e) * _dot(dds, ds)


def _platform_work(mechanism: Mechanism, sample: _Sample, in_time: _Pose, virtual: _Pose, k: int) -> Any:
    """X = P + R xi, integrated over xi by mass, first and second moments; less the load's work."""
    m = arb(mechanism.platform.mass)
    r = [arb(value) for value in mechanism.platform.com.tolist()]
    inertia = [[arb(value) for value in row] for row in mechanism.platform.inertia.tolist()]
    half_trace = (inertia[0][0] + inertia[1][1] + inertia[2][2]) / 2
    second = [
        [half_trace * int(i == j) - inertia[i][j] + m * r[i] * r[j] for j in range(3)] for i in range(3)
    ]
    g = mechanism.gravity.tolist()
    lift = [2 * value[2] - arb(gi) for value, gi in zip(in_time.position, g, strict=True)]
    ddR = [[2 * value[2] for value in row] for row in in_time.rotation]
    dP = [value[1] for value in virtual.position]
    dR = [[value[1] for value in row] for row in virtual.rotation]
    dx_m = [p + q for p, q in zip(dP, _times(dR, r), strict=True)]
    work = m * _dot(lift, dx_m) + m * _dot(_times(ddR, r), dP)
    for i in range(3):
        for j in range(3):
            work += second[i][j] * _dot([row[i] for row in dR], [row[j] for row in ddR])
    work -= _dot([arb(value) for value in sample.force], dx_m)
    return work - arb(sample.moment[k - 3]) if k >= 3 else work


def _series(coefficients: list[Matrix]) -> Matrix:
    return [[arb_series([matrix[i][j] for matrix in coefficients]) for j in range(3)] for i in range(3)]


def _skew(a: Vector) -> Matrix:
    x, y, z = a
    return [[arb(0), -z, y], [z, arb(0), -x], [-y, x, arb(0)]]


def _product(a: Matrix, b: Matrix) -> Matrix:
    return [[_dot(a[i], [row[j] for row in b]) for j in range(3)] for i in range(3)]


def _times(matrix: Matrix, vector: Vector) -> Vector:
    return [_dot(row, vector) for row in matrix]


def _dot(a: Vector, b: Vector) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
