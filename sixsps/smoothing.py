"""Quintic smoothing splines: the curve through noisy samples that can be differentiated twice.

Among all curves y it minimises sum (y(t_i) - y_i)^2 + smoothing * integral (y''')^2 dt. In the
interior of evenly sampled data that is a zero-phase low-pass filter 1 / (1 + (f / cutoff)^6), and so
the amount of smoothing is stated as its corner frequency. A cubic smoothing spline, which scipy
has, would not do: its second derivative, the acceleration, has corners at every sample.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize_scalar

from sixsps.arrays import Array

DEGREE = 5
# Order of the penalised derivative; polynomials of lower degree pass unsmoothed.
_ORDER = 3
FEWEST_SAMPLES = DEGREE + 1
_INFLATION = 1.4
_GRID = 25
_FEWEST_CYCLES = 0.25
_KNOTS_PER_PERIOD = 20
_MOST_EXACT = 100
_PROBES = 8


@dataclass(frozen=True, eq=False)
class SmoothingSpline:
    """A fitted smoothing spline.

    Attributes:
        spline: the curve; `spline(t, nu)` gives its derivatives.
        cutoff: corner frequency of the equivalent filter [Hz].
        noise: standard deviation of samples about the curve, in the samples' unit.
    """

    spline: BSpline
    cutoff: float
    noise: float


def fit(time: Array, samples: Array, cutoff: float | None = None) -> SmoothingSpline:
    """Fits one smoothing spline to all columns of `samples`.

    The amount of smoothing minimises the generalised cross-validation score with the degrees of
    freedom inflated by 1.4 (Kim & Gu, J. R. Stat. Soc. B 66, 2004), which needs no guess of the
    noise; without the factor it sometimes follows noise, and accelerations pay for that first.

    Args:
        time: (n,) strictly increasing [s], n >= 6.
        samples: (n, k) values that share one noise level and one smoothness.
        cutoff: corner frequency [Hz]; chosen from the data by default.
    """
    if cutoff is None:
        cutoff = _best_cutoff(time, samples)
    problem = _Problem.build(time, samples, cutoff)
    coefficients = problem.solve(problem.projection)
    residual = samples - problem.design @ coefficients
    spline = BSpline(problem.knots, coefficients, DEGREE)
    return SmoothingSpline(spline, cutoff, float(np.sqrt(np.mean(residual**2))))


def _best_cutoff(time: Array, samples: Array) -> float:
    duration = float(time[-1] - time[0])
    nyquist = 0.5 * (len(time) - 1) / duration
    grid = np.linspace(math.log(_FEWEST_CYCLES / duration), math.log(nyquist), _GRID)
    probes = _probes(len(time))

    def score(log_cutoff: float) -> float:
        return _Problem.build(time, samples, math.exp(log_cutoff)).score(probes)

    lowest = int(np.argmin([score(point) for point in grid]))
    bounds = (grid[max(lowest - 1, 0)], grid[min(lowest + 1, _GRID - 1)])
    best = minimize_scalar(score, bounds=bounds, method="bounded", options={"xatol": 0.01})
    return math.exp(float(best.x))


@dataclass(frozen=True, eq=False)
class _Problem:
    """The penalised least-squares problem for one cutoff, banded, on evenly spaced knots.

    The knots are as close as the samples or, where that is wider, a twentieth of the shortest
    period that passes: closer ones would change nothing but the condition of the normal equations.
    """

    samples: Array
    knots: Array
    design: sparse.csr_array
    projection: Array
    factor: Array

    @classmethod
    def build(cls, time: Array, samples: Array, cutoff: float) -> _Problem:
        duration = float(time[-1] - time[0])
        finest = (len(time) - 1) / duration
        intervals = math.ceil(duration * min(finest, _KNOTS_PER_PERIOD * cutoff))
        width = duration / intervals
        breaks = np.arange(intervals + 1.0)
        knots = np.r_[[0.0] * DEGREE, breaks, [float(intervals)] * DEGREE]
        scaled = np.clip((time - time[0]) / width, 0.0, intervals)
        design = sparse.csr_array(BSpline.design_matrix(scaled, knots, DEGREE))
        per_interval = (len(time) - 1) / intervals
        smoothing = per_interval * (2 * math.pi * cutoff * width) ** (-2 * _ORDER)
        factor = cholesky_banded(_upper_band(design.T @ design) + smoothing * _penalty(knots))
        return cls(samples, knots * width, design, design.T @ samples, factor)

    def solve(self, projection: Array) -> Array:
        solution: Array = cho_solve_banded((self.factor, False), projection)
        return solution

    def score(self, probes: Array) -> float:
        """Logarithm of the generalised cross-validation score, degrees of freedom inflated."""
        residual = self.samples - self.design @ self.solve(self.projection)
        smoothed = self.design @ self.solve(self.design.T @ probes)
        freedom = len(self.samples) - _INFLATION * float(np.sum(probes * smoothed))
        if freedom <= 0:
            return math.inf
        # Rounding is the floor of the misfit: samples of a polynomial leave nothing else.
        floor = (np.finfo(float).eps * float(np.abs(self.samples).max(initial=0.0))) ** 2 + 1e-300
        return math.log(float(np.mean(residual**2)) + floor) - 2 * math.log(freedom)


def _probes(n: int) -> Array:
    """Vectors whose quadratic forms add up to a trace: exactly for few samples, else on average."""
    if n <= _MOST_EXACT:
        return np.eye(n)
    signs = np.random.default_rng(0).integers(0, 2, (n, _PROBES)) * 2.0 - 1.0
    return np.asarray(signs / math.sqrt(_PROBES), dtype=np.float64)


def _penalty(knots: Array) -> Array:
    """Upper band of the integral of products of third derivatives, exact by Gauss-Legendre."""
    breaks = knots[DEGREE:-DEGREE]
    nodes, weights = np.polynomial.legendre.leggauss(_ORDER)
    half = np.diff(breaks) / 2
    points = (breaks[:-1, None] + half[:, None] * (nodes + 1)).ravel()
    reduced = knots[_ORDER:-_ORDER]
    basis = sparse.csr_array(BSpline.design_matrix(points, reduced, DEGREE - _ORDER))
    third = basis @ _derivative(knots)
    return _upper_band(third.T @ sparse.diags_array((half[:, None] * weights).ravel()) @ third)


def _derivative(knots: Array) -> sparse.csr_array:
    """Matrix from the coefficients of a quintic spline to those of its third derivative."""
    product = sparse.eye_array(len(knots) - DEGREE - 1, format="csr")
    for degree in range(DEGREE, DEGREE - _ORDER, -1):
        inner = knots[DEGREE - degree + 1 : len(knots) - (DEGREE - degree) - 1]
        spans = inner[degree:] - inner[:-degree]
        size = product.shape[0]
        step = sparse.diags_array(
            [-np.ones(size - 1), np.ones(size - 1)], offsets=[0, 1], shape=(size - 1, size)
        )
        product = sparse.csr_array(sparse.diags_array(degree / spans) @ step @ product)
    return product


def _upper_band(matrix: sparse.sparray) -> Array:
    band = np.zeros((DEGREE + 1, matrix.shape[0]))
    dia = sparse.csr_array(matrix)
    for offset in range(DEGREE + 1):
        band[DEGREE - offset, offset:] = dia.diagonal(offset)
    return band
