"""The locally nearest points of the set of singular poses, for many poses and starts at once."""

from __future__ import annotations

from copy import copy

import numpy as np
from numpy.typing import NDArray

from sixsps.arrays import Array
from sixsps.singular_poses.surface import SingularSet, left_jacobians, turned

_ITERATIONS, _HALVINGS = 60, 12
# Steps of this size, relative, leave errors of its square in the distance.
_CONVERGED = 1e-7
# Of sigma_min over sigma_max. Newton's method leaves some units of roundoff.
_SINGULAR = 1e-10
# A decrease of the merit that is worth a step (Armijo).
_SUFFICIENT = 1e-4


class Neighbourhood:
    """g around some poses, by x = (displacement, rotation vector), whose length is the distance.

    Args:
        singular_set: of a mechanism.
        place: (n, 3) positions in units of L.
        rotation: (n, 3, 3) orientations.
    """

    def __init__(self, singular_set: SingularSet, place: Array, rotation: Array) -> None:
        self._set, self.place, self.rotation = singular_set, place, rotation
        rows = np.linalg.norm(singular_set.matrices(place, rotation), axis=2)
        # A leg of no length has a row of no length, and the pose is in the set.
        self._scale = np.where(rows > 0, rows, 1.0).prod(axis=1)

    def __getitem__(self, chosen: NDArray[np.intp]) -> Neighbourhood:
        part = copy(self)
        part.place, part.rotation = self.place[chosen], self.rotation[chosen]
        part._scale = self._scale[chosen]
        return part

    def values(self, x: Array) -> Array:
        """Returns (n,) g at x (n, 6), over the product of the row lengths at x = 0."""
        return self._set.values(self.place + x[:, :3], turned(x[:, 3:], self.rotation)) / self._scale

    def gradients(self, x: Array) -> tuple[Array, Array]:
        """Returns (n,) values and (n, 6) their gradients by x."""
        g, slope = self._set.gradients(self.place + x[:, :3], turned(x[:, 3:], self.rotation))
        slope[:, 3:] = np.einsum("nji,nj->ni", left_jacobians(x[:, 3:]), slope[:, 3:])
        return g / self._scale, slope / self._scale[:, None]

    def are_singular(self, x: Array) -> Array:
        """Returns (n,) whether the poses at x are singular and no rotation is the longer way round."""
        M = self._set.matrices(self.place + x[:, :3], turned(x[:, 3:], self.rotation))
        sigma = np.linalg.svd(M, compute_uv=False)
        short = np.linalg.norm(x[:, 3:], axis=1) <= np.pi * (1 + _CONVERGED)
        return (sigma[:, -1] <= _SINGULAR * sigma[:, 0]) & short


def descended(around: Neighbourhood, x: Array) -> Array:
    """Returns (n, 6) singular points that are locally nearest to x = 0.

    Steps to the nearest point of the tangent plane of g at x, shortened until |x|^2 / 2 + c |g| has
    decreased (the HLRF method of structural reliability with the line search of Zhang & Der Kiureghian,
    1995). Rows that come to no end stay where they got.

    Args:
        around: the poses.
        x: (n, 6) to begin with.
    """
    x, active = x.copy(), np.arange(len(x))
    for _ in range(_ITERATIONS):
        if not active.size:
            break
        here = around[active]
        y = x[active]
        g, slope = here.gradients(y)
        step, push = _tangential(y, g, slope)
        moved = _shortened(here, y, g, step, push)
        x[active] = moved
        size = np.linalg.norm(moved - y, axis=1)
        active = active[size > _CONVERGED * (1e-6 + np.linalg.norm(moved, axis=1))]
    return put_on_the_set(around, x)


def put_on_the_set(around: Neighbourhood, x: Array) -> Array:
    """Returns x after some steps of Newton's method towards g = 0, each the shortest."""
    for _ in range(3):
        g, slope = around.gradients(x)
        square = np.sum(slope**2, axis=1)
        factor = np.divide(g, square, out=np.zeros_like(g), where=square > 0)
        x = x - factor[:, None] * slope
    return x


def _tangential(x: Array, g: Array, slope: Array) -> tuple[Array, Array]:
    """Returns (n, 6) steps to the nearest points of the tangent planes, and the weights c of |g|."""
    square = np.sum(slope**2, axis=1)
    safe = np.where(square > 0, square, 1.0)
    nearest = ((np.sum(slope * x, axis=1) - g) / safe)[:, None] * slope
    far = np.maximum(np.linalg.norm(x, axis=1), np.linalg.norm(nearest, axis=1))
    step = np.where((square > 0)[:, None], nearest - x, 0.0)
    # A rotation by more than half a turn is a detour.
    length = np.linalg.norm(step, axis=1, keepdims=True)
    return step * np.minimum(1.0, np.pi / 2 / np.maximum(length, 1e-300)), 2 * far / np.sqrt(safe)


def _shortened(around: Neighbourhood, x: Array, g: Array, step: Array, weight: Array) -> Array:
    """Returns the points on the way along the steps at which the merit has decreased."""
    merit = np.sum(x**2, axis=1) / 2 + weight * np.abs(g)
    slope = np.minimum(np.sum(x * step, axis=1) - weight * np.abs(g), 0.0)
    factor, open_ = np.ones(len(x)), np.arange(len(x))
    for _ in range(_HALVINGS):
        trial = x[open_] + factor[open_, None] * step[open_]
        value = np.abs(around[open_].values(trial))
        found = np.sum(trial**2, axis=1) / 2 + weight[open_] * value
        done = found <= merit[open_] + _SUFFICIENT * factor[open_] * slope[open_]
        open_ = open_[~done]
        if not open_.size:
            break
        factor[open_] /= 2
    factor[open_] = 0.0
    return x + factor[:, None] * step
