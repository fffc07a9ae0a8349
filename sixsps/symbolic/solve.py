"""Linear systems J x = b of six unknowns without a branch, which every lane of a SIMD unit can share.

Modified Gram-Schmidt on the columns of J and b together. The right-hand side is a column like the
others, never a product with a Q that has lost its orthogonality; so the solve is backward stable, as
Householder's is (Bjorck, BIT 7, 1967; Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed.,
theorem 20.3). CasADi's own symbolic solve multiplies by a Q^T that is orthogonal no more: cond(J)^2.
No square root, no comparison, and one division a column.
"""

from __future__ import annotations

from functools import reduce

import casadi as ca

# sigma_min >= (5 / |J|_F^2)^(5/2) |det J| (Yu & Gu, Linear Algebra Appl. 252, 1997), |J|_2 <= |J|_F.
_HADAMARD = 5.0**5


class Factors:
    """J = Q D R, columns of Q at right angles, D their squared lengths inverted, R with a unit diagonal.

    Attributes:
        determinant_squared: of J.
    """

    def __init__(self, J: ca.SX) -> None:
        columns = ca.horzsplit(ca.densify(J))
        self._columns: list[ca.SX] = []
        self._inverses: list[ca.SX] = []
        self._upper: list[list[ca.SX]] = []
        squares: list[ca.SX] = []
        while columns:
            head, *columns = columns
            squares.append(_dot(head, head))
            self._columns.append(head)
            self._inverses.append(1 / squares[-1])
            row = [self._shared(head, column) for column in columns]
            columns = [column - factor * head for column, factor in zip(columns, row, strict=True)]
            self._upper.append(row)
        self.determinant_squared = reduce(ca.times, squares)

    def solve(self, right: ca.SX) -> ca.SX:
        """Returns x (6,) with J x = right, backward stable."""
        shares = []
        for head, inverse in zip(self._columns, self._inverses, strict=True):
            shares.append(_dot(head, right) * inverse)
            right = right - shares[-1] * head
        return self._back_substituted(shares)

    def inverse(self) -> ca.SX:
        """Returns J^-1, with errors of cond(J) unit roundoffs of its norm, as any explicit inverse has."""
        rows = [(inverse * head).T for head, inverse in zip(self._columns, self._inverses, strict=True)]
        return self._back_substituted(rows)

    def _shared(self, head: ca.SX, column: ca.SX) -> ca.SX:
        return _dot(head, column) * self._inverses[-1]

    def _back_substituted(self, right: list[ca.SX]) -> ca.SX:
        """Returns X with R X = the rows of `right`."""
        X: list[ca.SX] = []
        for row, upper in zip(reversed(right), reversed(self._upper), strict=True):
            for factor, known in zip(upper, reversed(X), strict=True):
                row = row - factor * known
            X.append(row)
        return ca.vertcat(*reversed(X))


def regularity(determinant_squared: ca.SX, frobenius_squared: float) -> ca.SX:
    """Returns a lower bound of cond(J)^-2.

    Args:
        determinant_squared: of J.
        frobenius_squared: upper bound of the sum of all squared entries of J.
    """
    return determinant_squared * (_HADAMARD / frobenius_squared**6)


def _dot(a: ca.SX, b: ca.SX) -> ca.SX:
    """Scalar product summed in pairs: shorter chains for the processor, smaller rounding errors."""
    terms = ca.vertsplit(a * b)
    while len(terms) > 1:
        pairs = zip(terms[::2], terms[1::2], strict=False)
        terms = [x + y for x, y in pairs] + terms[len(terms) // 2 * 2 :]
    return terms[0]
