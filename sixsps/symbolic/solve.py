"""Linear systems J X = B of six unknowns without a branch, which every lane of a SIMD unit can share.

Modified Gram-Schmidt on the columns of J and B together. The right-hand sides are columns like the
others, never products with a Q that has lost its orthogonality; so the solve is backward stable, as
Householder's is (Bjorck, BIT 7, 1967; Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed.,
theorem 20.3). CasADi's own symbolic solve is the classical form, which loses cond(J)^2.
No square root, no comparison, and one division a column.
"""

from __future__ import annotations

from functools import reduce

import casadi as ca

# sigma_min >= (5 / |J|_F^2)^(5/2) |det J| (Yu & Gu, Linear Algebra Appl. 252, 1997), |J|_2 <= |J|_F.
_HADAMARD = 5.0**5


def solve(J: ca.SX, right: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Returns X (6, m) with J X = right, and the square of the determinant of J.

    Args:
        J: (6, 6), rows of comparable size.
        right: (6, m).
    """
    columns = ca.horzsplit(ca.horzcat(ca.densify(J), right))
    upper: list[list[ca.SX]] = []
    squares: list[ca.SX] = []
    for _ in range(6):
        head, *rest = columns
        square = _dot(head, head)
        inverse = 1 / square
        row = [_dot(head, column) * inverse for column in rest]
        columns = [column - factor * head for column, factor in zip(rest, row, strict=True)]
        upper.append(row)
        squares.append(square)
    solutions = [_back_substituted(upper, 6 + k) for k in range(right.size2())]
    return ca.horzcat(*solutions), reduce(ca.times, squares)


def regularity(determinant_squared: ca.SX, frobenius_squared: float) -> ca.SX:
    """Returns a lower bound of cond(J)^-2.

    Args:
        determinant_squared: of J.
        frobenius_squared: upper bound of the sum of all squared entries of J.
    """
    return determinant_squared * (_HADAMARD / frobenius_squared**6)


def _back_substituted(upper: list[list[ca.SX]], column: int) -> ca.SX:
    """Returns x with R x = the column, R having ones on its diagonal; row k begins right of it."""
    x: list[ca.SX] = []
    for k in reversed(range(6)):
        row = upper[k]
        known = zip(row[: 5 - k], x[::-1], strict=True)
        x.append(reduce(lambda left, term: left - term[0] * term[1], known, row[column - k - 1]))
    return ca.vertcat(*x[::-1])


def _dot(a: ca.SX, b: ca.SX) -> ca.SX:
    """Scalar product summed in pairs: shorter chains for the processor, smaller rounding errors."""
    terms = ca.vertsplit(a * b)
    while len(terms) > 1:
        pairs = zip(terms[::2], terms[1::2], strict=False)
        terms = [x + y for x, y in pairs] + terms[len(terms) // 2 * 2 :]
    return terms[0]
