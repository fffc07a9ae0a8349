"""How close a pose is to a singularity, and the solve J F = C that respects it."""

from __future__ import annotations

import numpy as np

from sixsps.arrays import Array

# A solve loses about log10(condition) of float64's 16 digits. Beyond this number fewer than four
# would be left, and the forces are reported as NaN instead.
SINGULAR_CONDITION = 1e12

# Below it a bound of the condition number, with what rounding does to it, says for certain that a pose is
# no singular one.
REGULAR_CONDITION = SINGULAR_CONDITION / 2


def condition_numbers(jacobian: Array, lengths: Array, characteristic_length: float) -> Array:
    """Returns the 2-norm condition number of the Jacobian with its angular columns made metric.

    Args:
        jacobian: (n, 6, 6) with length_rates = jacobian @ [velocity; angular_velocity].
        lengths: (n, 6) leg lengths; a leg of no length has no direction, whatever J says [m].
        characteristic_length: length that divides the angular columns [m].

    Returns:
        (n,) condition numbers; infinite where a leg has no direction.
    """
    scaled = jacobian / np.array([1.0] * 3 + [characteristic_length] * 3)
    conditions = np.full(len(scaled), np.inf)
    directed = (lengths > characteristic_length / SINGULAR_CONDITION).all(axis=1)
    with np.errstate(divide="ignore"):
        conditions[directed] = np.linalg.cond(scaled[directed])
    return conditions


def solve_leg_forces(jacobian: Array, wrench: Array, condition: Array, characteristic_length: float) -> Array:
    """Solves J F = C (eq. 31), J being the transpose of `jacobian`, by LU with partial pivoting.

    Args:
        jacobian: (n, 6, 6) with length_rates = jacobian @ [velocity; angular_velocity].
        wrench: (n, 6) C, force [N] and moment about O1 [N m], world axes.
        condition: (n,) `condition_numbers` of the samples.
        characteristic_length: length that makes the moment rows comparable to the force rows [m].

    Returns:
        (n, 6) leg forces [N], positive in extension; NaN where the condition number exceeds
        `SINGULAR_CONDITION`.
    """
    forces = np.full(wrench.shape, np.nan)
    regular = condition <= SINGULAR_CONDITION
    scale = np.array([1.0] * 3 + [characteristic_length] * 3)
    rows = np.swapaxes(jacobian[regular], 1, 2) / scale[:, None]
    forces[regular] = np.linalg.solve(rows, (wrench[regular] / scale)[..., None])[..., 0]
    return forces
