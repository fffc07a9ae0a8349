"""The inertial parameters that a motion identifies, and their estimates from measured leg forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixsps.arrays import Array, frozen
from sixsps.errors import InputError, MotionError
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.regressor import INERTIAL_PARAMETERS, SHARED_LEG_PARAMETERS, regressor, wrench_forces
from sixsps.singularity import SINGULAR_CONDITION

TOLERANCE = 1e-8
"""Part of a column, relative to its norm, that has to be independent of others for a rank.

Rounding leaves unit roundoff times cond(J) of a dependent one, 1e-12 away from singular poses; less
than 1e-8 of an independent one only force sensors of more than eight digits would tell.
"""


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """Combinations of inertial parameters that rows of a regressor identify, and no others.

    base = combinations @ parameters, and rows[:, columns] @ base = rows @ parameters.

    Attributes:
        parameters: (p) names of the inertial parameters.
        columns: (r) indices of the independent columns; each leads one combination.
        combinations: (r, p) coefficients, 1 at its own leading parameter; SI units.
        condition: condition number of the independent columns, each scaled to norm 1.
    """

    parameters: tuple[str, ...]
    columns: tuple[int, ...]
    combinations: Array
    condition: float

    def __len__(self) -> int:
        return len(self.columns)

    @property
    def names(self) -> tuple[str, ...]:
        """The leading parameter of every combination."""
        return tuple(self.parameters[column] for column in self.columns)

    @property
    def unidentified(self) -> tuple[str, ...]:
        """Parameters that no combination contains: they have no effect on the forces."""
        seen = np.any(self.combinations != 0, axis=0)
        return tuple(name for name, effect in zip(self.parameters, seen, strict=True) if not effect)

    def words(self) -> tuple[str, ...]:
        """Returns every combination as a sum that starts with its name, coefficients to six digits."""
        return tuple(self._sum(index) for index in range(len(self)))

    def _sum(self, index: int) -> str:
        row, leader = self.combinations[index], self.columns[index]
        text = self.parameters[leader]
        for column in np.flatnonzero(row):
            if column != leader:
                size = f"{abs(row[column]):.6g} ".removeprefix("1 ")
                text += f" {'-' if row[column] < 0 else '+'} {size}{self.parameters[column]}"
        return text


def base_parameters(rows: Array, *, tolerance: float = TOLERANCE) -> BaseParameters:
    """Returns the combinations of inertial parameters that forces determine, by rank-revealing QR.

    Columns are scaled to norm 1, so that no unit decides. What bodies share is counted to the
    platform, and what only links share to the lower one. Coefficients below `tolerance`, in these
    units, are 0.

    Args:
        rows: (k, 46) rows of `regressor`, divided by standard deviations where these differ; (k, 16)
            are taken for legs that share their parameters.
        tolerance: relative size of what is still told from 0; see `TOLERANCE`.

    Raises:
        InputError: `rows` has another shape, or an entry is not finite, as at singular poses.
    """
    shared = np.shape(rows)[-1:] == (len(SHARED_LEG_PARAMETERS),)
    parameters = SHARED_LEG_PARAMETERS if shared else INERTIAL_PARAMETERS
    rows = frozen(rows, (None, len(parameters)), "rows", InputError)
    scaled, norms = _scaled(rows, parameters, tolerance)
    _, columns = np.linalg.qr(scaled)
    bodies = (np.array([body in name for name in parameters]) for body in ("platform.", "lower.", "upper."))
    chosen = _independent(columns, [np.flatnonzero(body) for body in bodies], tolerance)
    Q, R = np.linalg.qr(columns[:, chosen])
    coefficients = np.linalg.solve(R, Q.T @ columns)
    coefficients[np.abs(coefficients) <= tolerance] = 0
    combinations = coefficients * norms / norms[chosen][:, None]
    combinations[:, chosen] = np.eye(len(chosen))
    condition = float(np.linalg.cond(R)) if chosen else 1.0
    return BaseParameters(parameters, tuple(chosen), combinations, condition)


@dataclass(frozen=True, eq=False)
class Identification:
    """Base parameters estimated from measured leg forces.

    Attributes:
        base: the combinations that the motion identifies.
        values: (r,) estimates, SI units.
        standard_deviations: (r,) of the estimates.
        covariance: (r, r) of the estimates.
        intervals: (r, 2) bounds of the 95 % confidence intervals, by Student's t.
        residuals: (n, 6) measured less modelled forces [N].
        residual_std: standard deviation of the residuals [N]; where `sigma` was given, their
            standard deviation in units of `sigma`: near 1 if that was right.
        degrees_of_freedom: number of forces less number of base parameters.
    """

    base: BaseParameters
    values: Array
    standard_deviations: Array
    covariance: Array
    intervals: Array
    residuals: Array
    residual_std: float
    degrees_of_freedom: int


def identify(
    mechanism: Mechanism,
    motion: Motion,
    measured_forces: ArrayLike,
    sigma: ArrayLike | None = None,
    *,
    base: BaseParameters | None = None,
    shared_legs: bool = False,
) -> Identification:
    """Returns the base parameters that explain measured leg forces, by weighted least squares.

    The noise of the forces is taken as independent; its size is estimated from the residuals, so
    that `sigma` only has to say how the noise is distributed over legs and samples.

    Args:
        mechanism: anchors, gravity, and the point where the external wrench acts; see
            `wrench_forces`. No other inertia is read.
        motion: n samples, as measured or estimated; their errors are not accounted for.
        measured_forces: (n, 6) leg forces [N], positive in extension.
        sigma: standard deviations of the measured forces [N]: a number, (6,) or (n, 6).
        base: combinations to estimate, as of a richer motion; by default those of this one.
        shared_legs: the six legs have the same inertia; with `base`, what that was made for.

    Raises:
        MotionError: the motion has singular poses or too few samples, moves nothing, or does not
            identify `base`.
        InputError: forces or standard deviations of another shape, not finite, or sigma not > 0.
    """
    measured = frozen(measured_forces, (len(motion), 6), "measured_forces", InputError)
    weights = 1 / _standard_deviations(sigma, len(motion))
    _check_regular(mechanism, motion)
    shared = shared_legs if base is None else base.parameters == SHARED_LEG_PARAMETERS
    weighted = weights[..., None] * regressor(mechanism, motion, shared_legs=shared)
    rows = weighted.reshape(-1, weighted.shape[2])
    if base is None:
        base = base_parameters(rows)
    else:
        _check_determined(base, rows)
    if not 0 < len(base) < len(rows):
        found = f"{len(rows)} forces for {len(base)} base parameters"
        raise MotionError("motion", found, "at least one parameter and more forces than parameters")
    right = measured - wrench_forces(mechanism, motion)
    return _least_squares(base, rows[:, base.columns], right, weights)


def _least_squares(base: BaseParameters, columns: Array, right: Array, weights: Array) -> Identification:
    from scipy.stats import t

    scale = np.linalg.norm(columns, axis=0)
    Q, R = np.linalg.qr(columns / scale)
    weighted = (weights * right).ravel()
    values = np.linalg.solve(R, Q.T @ weighted) / scale
    residuals = weighted - columns @ values
    freedom = len(weighted) - len(values)
    residual_std = float(np.sqrt(residuals @ residuals / freedom))
    root = residual_std * np.linalg.inv(R) / scale[:, None]
    deviations = np.linalg.norm(root, axis=1)
    reach = t.ppf(0.975, freedom) * deviations  # both tails of 95 %
    return Identification(
        base=base,
        values=values,
        standard_deviations=deviations,
        covariance=root @ root.T,
        intervals=np.column_stack([values - reach, values + reach]),
        residuals=residuals.reshape(right.shape) / weights,
        residual_std=residual_std,
        degrees_of_freedom=freedom,
    )


def _standard_deviations(sigma: ArrayLike | None, n: int) -> Array:
    given = 1.0 if sigma is None else sigma
    deviations = frozen(given, (n, 6)[max(2 - np.ndim(given), 0) :], "sigma", InputError)
    if not (deviations > 0).all():
        raise InputError("sigma", float(deviations.min()), "standard deviations > 0 [N]")
    return np.broadcast_to(deviations, (n, 6))


def _check_regular(mechanism: Mechanism, motion: Motion) -> None:
    condition = inverse_kinematics(mechanism, motion).condition
    singular = np.count_nonzero(~(condition <= SINGULAR_CONDITION))
    if singular:
        raise MotionError("motion", f"{singular} samples at singular poses", "regular poses only")


def _check_determined(base: BaseParameters, rows: Array) -> None:
    """Raises MotionError unless weighted rows of the regressor determine all of `base`."""
    columns, _ = _scaled(rows[:, base.columns], base.names, TOLERANCE)
    rank = len(_independent(columns, [np.arange(len(base))], TOLERANCE))
    if rank < len(base):
        wanted = "a motion that accelerates and turns the platform along and about all axes"
        raise MotionError("motion", f"determines {rank} of {len(base)} base parameters", wanted)


def _scaled(rows: Array, parameters: Sequence[str], tolerance: float) -> tuple[Array, Array]:
    """Returns the columns over their norms, and the norms; 0 and 0 where a column is but rounding.

    What is rounding is told by the largest column of the same unit: a motion without rotation about
    an axis leaves 1e-16 of what other inertias do, not 0.
    """
    norms = np.linalg.norm(rows, axis=0)
    for unit in (".mass", ".first_moment", ".inertia"):
        same = np.array([unit in name for name in parameters], dtype=bool)
        norms[same & (norms <= tolerance * norms[same].max(initial=0.0))] = 0
    return np.divide(rows, norms, out=np.zeros_like(rows), where=norms > 0), norms


def _independent(columns: Array, groups: Sequence[NDArray[np.intp]], tolerance: float) -> list[int]:
    """Returns columns of norm 1 that give all others, as many of the first group as there can be."""
    from scipy.linalg import qr

    chosen: list[int] = []
    for group in groups:
        Q, _ = np.linalg.qr(columns[:, chosen])
        rest = columns[:, group] - Q @ (Q.T @ columns[:, group])
        R, order = qr(rest, mode="r", pivoting=True)
        rank = np.count_nonzero(np.abs(np.diag(R)) > tolerance)
        chosen += group[order[:rank]].tolist()
    return sorted(chosen)
