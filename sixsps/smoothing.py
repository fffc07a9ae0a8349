"""Quintic smoothing splines: the curve through noisy samples that can be differentiated twice.

Among all curves y it minimises sum (y(t_i) - y_i)^2 + smoothing * integral (y''')^2 dt. In the
interior of evenly sampled data that is a zero-phase low-pass filter 1 / (1 + (f / cutoff)^6), and so
the amount of smoothing is stated as its corner frequency. A cubic smoothing spline, which scipy
has, would not do: its second derivative, the acceleration, has corners at every sample.

A recording is cut at long pauses, over which nothing is known; every piece has a curve of its own,
and all share one cutoff.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.linalg import LinAlgError
from scipy import sparse
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize_scalar

from sixsps.arrays import Array
from sixsps.errors import MotionError

DEGREE = 5
# Order of the penalised derivative; polynomials of lower degree pass unsmoothed.
_ORDER = 3
FEWEST_SAMPLES = DEGREE + 1
# Kim & Gu (2004): 1.4 times the degrees of freedom.
_INFLATION = 1.4
_GRID = 25
_FEWEST_CYCLES, _SLOWEST_CYCLES = 0.25, 0.01
_KNOTS_PER_PERIOD = 20
_MOST_EXACT = 100
_PROBES = 8
# A step is a pause when it is this much longer than nine in ten of the others.
_PAUSE = 50
_SHORTEST_STEP_S = 1e-9


@dataclass(frozen=True, eq=False)
class SmoothingSpline:
    """A fitted smoothing spline.

    Attributes:
        cutoff: corner frequency of the equivalent filter [Hz].
        noise: standard deviation of samples about the curve, in the samples' unit.
    """

    cutoff: float
    noise: float
    _pieces: tuple[_Piece, ...]
    _curves: tuple[BSpline, ...]

    def __call__(self, time: Array, order: int = 0) -> Array:
        """Returns the curve or a derivative of it.

        Args:
            time: (m,) where to evaluate [s].
            order: of the derivative.

        Returns:
            (m, k) in the samples' unit, per second to the power of `order`.
        """
        starts = np.array([piece.start for piece in self._pieces[1:]])
        which = np.searchsorted(starts, time, side="right")
        values = np.empty((len(time), self._pieces[0].samples.shape[1]))
        for index, (piece, curve) in enumerate(zip(self._pieces, self._curves, strict=True)):
            here = which == index
            elapsed = time[here] - piece.start
            values[here] = curve(elapsed, order) + piece.parabola_at(elapsed, order)
        return values


def fit(time: Array, samples: Array, cutoff: float | None = None) -> SmoothingSpline:
    """Fits one smoothing spline to all columns of `samples`.

    The amount of smoothing minimises the generalised cross-validation score with the degrees of
    freedom inflated by 1.4 (Kim & Gu, J. R. Stat. Soc. B 66, 2004), which needs no guess of the
    noise; without the factor it sometimes follows noise, and accelerations pay for that first.

    Args:
        time: (n,) strictly increasing [s].
        samples: (n, k) values that share one noise level and one smoothness.
        cutoff: corner frequency [Hz]; chosen from the data by default.

    Raises:
        MotionError: fewer than six samples between two pauses, or a cutoff that the samples cannot
            resolve.
    """
    pieces = _pieces(time, samples)
    duration = max(piece.duration for piece in pieces)
    nyquist = 0.5 * sum(len(piece.samples) - 1 for piece in pieces) / sum(p.duration for p in pieces)
    if cutoff is None:
        cutoff = _best_cutoff(pieces, _FEWEST_CYCLES / duration, nyquist)
    elif not _SLOWEST_CYCLES / duration <= cutoff <= nyquist:
        allowed = f"{_SLOWEST_CYCLES / duration:.3g} to {nyquist:.3g} Hz with these samples"
        raise MotionError("cutoff", cutoff, allowed)
    try:
        fits = [piece.fit(cutoff) for piece in pieces]
    except LinAlgError:
        found = "too unevenly spaced to be smoothed"
        raise MotionError("t", found, "samples that are not bunched together") from None
    residual = np.concatenate([fit.residual for fit in fits])
    noise = float(np.sqrt(np.mean(residual**2)))
    return SmoothingSpline(cutoff, noise, tuple(pieces), tuple(fit.curve for fit in fits))


def _pieces(time: Array, samples: Array) -> list[_Piece]:
    steps = np.diff(time)
    usual = float(np.quantile(steps, 0.9))
    if usual < _SHORTEST_STEP_S:
        allowed = f"steps of at least {_SHORTEST_STEP_S:g} s, or twist and acceleration columns"
        raise MotionError("t", f"steps of {usual:g} s", allowed)
    cuts = np.flatnonzero(steps > _PAUSE * usual) + 1
    pieces = []
    for rows in np.split(np.arange(len(time)), cuts):
        if len(rows) < FEWEST_SAMPLES:
            found = f"{len(rows)} samples between pauses, from t = {time[rows[0]]:g} s"
            allowed = f"at least {FEWEST_SAMPLES} samples, or twist and acceleration columns"
            raise MotionError("rows", found, allowed)
        pieces.append(_Piece.build(time[rows], samples[rows]))
    return pieces


def _best_cutoff(pieces: list[_Piece], slowest: float, nyquist: float) -> float:
    grid = np.linspace(math.log(slowest), math.log(nyquist), _GRID)

    def score(log_cutoff: float) -> float:
        """Logarithm of the generalised cross-validation score, degrees of freedom inflated."""
        try:
            fits = [piece.fit(math.exp(log_cutoff)) for piece in pieces]
        except LinAlgError:
            return math.inf
        residual = np.concatenate([fit.residual for fit in fits])
        trace = sum(fit.trace(piece.probes) for fit, piece in zip(fits, pieces, strict=True))
        freedom = len(residual) - _INFLATION * trace
        if freedom <= 0:
            return math.inf
        # Rounding is the floor of the misfit: samples of a parabola leave nothing else.
        largest = max(piece.largest for piece in pieces)
        floor = (np.finfo(float).eps * largest) ** 2 + 1e-300
        return math.log(float(np.mean(residual**2)) + floor) - 2 * math.log(freedom)

    lowest = int(np.argmin([score(point) for point in grid]))
    bounds = (grid[max(lowest - 1, 0)], grid[min(lowest + 1, _GRID - 1)])
    best = minimize_scalar(score, bounds=bounds, method="bounded", options={"xatol": 0.01})
    return math.exp(float(best.x))


@dataclass(frozen=True, eq=False)
class _Piece:
    """Samples between two pauses, less their parabola, which no smoothing changes."""

    start: float
    elapsed: Array
    samples: Array
    parabola: Array
    largest: float
    probes: Array

    @classmethod
    def build(cls, time: Array, samples: Array) -> _Piece:
        elapsed = time - time[0]
        basis = np.vander(elapsed / elapsed[-1], _ORDER, increasing=True)
        # In two steps, so that what is left of equal samples is exactly nothing.
        rest = samples - samples[0]
        parabola = np.linalg.lstsq(basis, rest)[0]
        rest = rest - basis @ parabola
        parabola[0] += samples[0]
        largest = float(np.abs(samples).max())
        return cls(float(time[0]), elapsed, rest, parabola, largest, _probes(len(time)))

    @property
    def duration(self) -> float:
        return float(self.elapsed[-1])

    def parabola_at(self, elapsed: Array, order: int) -> Array:
        slope = np.polynomial.polynomial.polyder(self.parabola, order)
        values = np.polynomial.polynomial.polyval(elapsed / self.duration, slope).T
        return np.asarray(values / self.duration**order, dtype=np.float64)

    def fit(self, cutoff: float) -> _Fit:
        """Solves the penalised least-squares problem, banded, on evenly spaced knots.

        The knots are as close as the samples or, where that is wider, a twentieth of the shortest
        period that passes: closer ones would change nothing but the condition of the equations.

        Raises:
            LinAlgError: the samples are too bunched together for these knots.
        """
        steps = len(self.samples) - 1
        intervals = min(steps, math.ceil(_KNOTS_PER_PERIOD * cutoff * self.duration))
        width = self.duration / intervals
        knots = np.r_[[0.0] * DEGREE, np.arange(intervals + 1.0), [float(intervals)] * DEGREE]
        scaled = np.clip(self.elapsed / width, 0.0, intervals)
        design = sparse.csr_array(BSpline.design_matrix(scaled, knots, DEGREE))
        smoothing = steps / intervals * (2 * math.pi * cutoff * width) ** (-2 * _ORDER)
        factor = cholesky_banded(_upper_band(design.T @ design) + smoothing * _penalty(knots))
        coefficients = cho_solve_banded((factor, False), design.T @ self.samples)
        residual = self.samples - design @ coefficients
        return _Fit(BSpline(knots * width, coefficients, DEGREE), residual, design, factor)


@dataclass(frozen=True, eq=False)
class _Fit:
    """A piece smoothed at one cutoff."""

    curve: BSpline
    residual: Array
    design: sparse.csr_array
    factor: Array

    def trace(self, probes: Array) -> float:
        """Returns the trace of the matrix that maps samples to smoothed samples."""
        smoothed = self.design @ cho_solve_banded((self.factor, False), self.design.T @ probes)
        return float(np.sum(probes * smoothed))


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
    third = basis @ _third_derivative(knots)
    return _upper_band(third.T @ sparse.diags_array((half[:, None] * weights).ravel()) @ third)


def _third_derivative(knots: Array) -> sparse.csr_array:
    """Matrix from the coefficients of a quintic spline to those of its third derivative."""
    product = sparse.eye_array(len(knots) - DEGREE - 1, format="csr")
    for degree in range(DEGREE, DEGREE - _ORDER, -1):
        inner = knots[DEGREE - degree + 1 : len(knots) - (DEGREE - degree) - 1]
        spans = inner[degree:] - inner[:-degree]
        size = product.shape[0]
        ones = np.ones(size - 1)
        step = sparse.diags_array([-ones, ones], offsets=[0, 1], shape=(size - 1, size))
        product = sparse.csr_array(sparse.diags_array(degree / spans) @ step @ product)
    return product


def _upper_band(matrix: sparse.sparray) -> Array:
    band = np.zeros((DEGREE + 1, matrix.shape[0]))
    rows = sparse.csr_array(matrix)
    for offset in range(min(DEGREE + 1, rows.shape[0])):
        band[DEGREE - offset, offset:] = rows.diagonal(offset)
    return band
