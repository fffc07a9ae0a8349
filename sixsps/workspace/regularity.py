"""On which side of the singularity the poses of a cell are, by a proven bound."""

from __future__ import annotations

import numpy as np

from sixsps.arrays import Array
from sixsps.home import home_position
from sixsps.margins import leg_vectors
from sixsps.mechanism import Mechanism
from sixsps.rotation import cross, skew
from sixsps.singularity import SINGULAR_CONDITION
from sixsps.workspace.charts import Chart
from sixsps.workspace.taylor import Scalars, Vectors

# Rounding of a singular value decomposition, relative to the largest singular value.
_ROUNDING = 256 * float(np.finfo(float).eps)
# |s''| is at most this times |S'|^2 / l^2, half of it bounds what is not linear in s = S / l.
_BENT = 1 / np.sqrt(3)
_SIGNS = np.array([[1, 1, 1], [1, 1, -1], [1, -1, 1], [1, -1, -1]])


def home_side(mechanism: Mechanism) -> float:
    """Returns the sign of the Jacobian's determinant at the home pose; 0 where it is singular."""
    legs = leg_vectors(mechanism, home_position(mechanism)[None], np.eye(3)[None])
    J = scaled_jacobian(mechanism, legs, np.eye(3)[None])[0]
    if not (np.isfinite(J).all() and np.linalg.cond(J) <= SINGULAR_CONDITION):
        return 0.0
    return float(np.linalg.slogdet(J)[0])


def side(chart: Chart, legs: Vectors, centre: Array, half: Array, sign: float) -> Scalars:
    """Returns (n, 1) numbers that have the sign of det J over cells, times `sign`.

    With J0 = U diag(sigma) V^T at the centre, Q = diag(sigma)^(-1/2) and K = Q U^T (J - J0) V Q, J is regular
    with the sign of det J0 where |K| < 1. Where that is not so, as near a singularity, the same holds
    of the first five rows and columns, A, while their K is smaller than 1; with J = [[A, b], [c, s]] in these
    axes, det J then has the sign of s - c A^-1 b, whose linear part is that of s = sigma_6 + u_6 . dJ v_6.

    Args:
        chart: of the parameters.
        legs: (n, 6) leg vectors over the cells.
        centre: (n, 3) parameters.
        half: (n, 3) half widths.
        sign: of the determinant at home.
    """
    J = scaled_jacobian(chart.mechanism, legs.value, chart.poses(centre)[1])
    slopes, error = _changes(chart, legs, centre, half)
    sound = np.asarray(np.isfinite(J).all(axis=(1, 2)) & np.isfinite(error).all(axis=1))
    U, sigma, Vt = np.linalg.svd(np.where(sound[:, None, None], J, np.eye(6)))
    error = np.where(sound[:, None], error, 1.0)
    signs = sign * np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    turned = np.einsum("nji,njkp,nlk->nilp", U, slopes, Vt, optimize=True)
    corners = np.einsum("nilp,cp,np->ncil", turned, _SIGNS, half, optimize=True)
    all_six, _, _ = _relative(U, sigma, corners, error, 6)
    five, c, b = _relative(U, sigma, corners, error, 5)
    near = sound & (five < 1)
    quadratic = np.divide(b * c, 1 - five, out=np.full(len(J), np.inf), where=near)
    reach = quadratic + np.sum(np.abs(U[:, :, 5]) * error, axis=1) + _ROUNDING * sigma[:, 0]
    certain = sound & (all_six < 1)
    value = np.where(certain, signs, np.where(near, signs * sigma[:, 5], 0.0))[:, None]
    slope = np.where((near & ~certain)[:, None], signs[:, None] * turned[:, 5, 5], 0.0)[:, None]
    reach = np.where(certain, all_six, np.where(near, reach, np.inf))[:, None]
    return Scalars(value, slope, -reach, reach)


def _relative(U: Array, sigma: Array, corners: Array, error: Array, size: int) -> tuple[Array, Array, Array]:
    """Returns (n,) bounds of |K| of the first rows and columns, and of the last row and column beside them.

    Args:
        U: (n, 6, 6) left singular vectors.
        sigma: (n, 6) singular values.
        corners: (n, 4, 6, 6) linear change at half of the corners of the cells, the others are its negative;
            what is linear in the parameters is largest at a corner.
        error: (n, 6) bounds of the size of the rest of each row of J.
        size: number of rows and columns.
    """
    regular = sigma[:, size - 1] > _ROUNDING * sigma[:, 0]
    root = np.sqrt(np.where(regular[:, None], sigma[:, :size], 1.0))
    K = corners[:, :, :size, :size] / (root[:, None, :, None] * root[:, None, None, :])
    # The size of each row's part in the axes U, over the roots.
    rows = np.linalg.norm(U[:, :, :size] / root[:, None, :], axis=2)
    rest = np.sum(rows * error, axis=1)
    found = _spectral(K).max(axis=1) + rest / root[:, -1] + _ROUNDING * sigma[:, 0] / root[:, -1] ** 2
    last = np.sum(np.abs(U[:, :, 5]) * error, axis=1) / root[:, -1]
    row = np.linalg.norm(corners[:, :, 5, :size] / root[:, None], axis=2).max(axis=1) + last
    column = np.linalg.norm(corners[:, :, :size, 5] / root[:, None], axis=2).max(axis=1) + rest
    return np.where(regular, found, np.inf), row, column


def _spectral(matrices: Array) -> Array:
    """Returns upper bounds of the spectral norms, the root of order 8 of the sum of all sigma^8."""
    squared = np.swapaxes(matrices, -1, -2) @ matrices
    return np.sqrt(np.sqrt(np.linalg.norm(squared @ squared, axis=(-2, -1))))


def _changes(chart: Chart, legs: Vectors, centre: Array, half: Array) -> tuple[Array, Array]:
    """Returns slopes (n, 6, 6, 3) of J's rows [s, c x s / L] and bounds (n, 6) of the size of the rest."""
    mechanism, L = chart.mechanism, chart.mechanism.characteristic_length
    arms = chart.carried(mechanism.platform_anchors, centre, half)
    c, size = arms.value, np.linalg.norm(mechanism.platform_anchors, axis=1)
    l = np.linalg.norm(legs.value, axis=-1)  # noqa: E741  the paper's letter
    apart = l > legs.move
    safe = np.where(apart, l, 1.0)
    s = legs.value / safe[..., None]
    across = np.eye(3) - s[..., :, None] * s[..., None, :]
    ds = across @ legs.slope / safe[..., None, None]
    shortest = np.where(apart, l - legs.move, 1.0)
    bent = np.where(apart, _BENT * (legs.move / shortest) ** 2 + legs.error / safe, np.inf)
    sine = np.where(apart, legs.move / safe, 1.0)
    turned = np.where(apart, np.sqrt(2 * (1 - np.sqrt(1 - sine**2))), 2.0)
    moment = (skew(c) @ ds - skew(s) @ arms.slope) / L
    error = np.hypot(bent, (arms.error + size * bent + arms.move * turned) / L)
    return np.concatenate([ds, moment], axis=2), error


def scaled_jacobian(mechanism: Mechanism, legs: Array, rotation: Array) -> Array:
    """Returns (n, 6, 6) the Jacobian, angular columns over the characteristic length; NaN at no length."""
    with np.errstate(invalid="ignore", divide="ignore"):
        s = legs / np.linalg.norm(legs, axis=-1, keepdims=True)
    arms = np.einsum("nij,mj->nmi", rotation, mechanism.platform_anchors)
    return np.concatenate([s, cross(arms, s) / mechanism.characteristic_length], axis=-1)
