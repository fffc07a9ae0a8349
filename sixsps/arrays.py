"""The one array type of this project, and the freezing of inputs."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixsps.errors import InputError

Array = NDArray[np.float64]

# No length, mass or time of a hexapod comes near, and products of several stay finite.
LARGEST = 1e50


def frozen(
    value: ArrayLike, shape: Sequence[int | None], place: str, error: Callable[..., InputError]
) -> Array:
    """Returns a read-only, C-contiguous float64 copy of `value`, checked for shape and finite numbers.

    Args:
        value: anything that numpy reads as numbers; never reshaped.
        shape: wanted shape, None where any size is allowed.
        place: name used in the message.
        error: class of the error that is raised.

    Raises:
        InputError: as `error`, when the shape is another or an entry is not a finite number.
    """
    wanted = "(" + ", ".join("n" if size is None else str(size) for size in shape) + ")"
    try:
        given = np.asarray(value)
    except ValueError:  # rows of different lengths
        given = np.array(None)
    if np.ma.is_masked(value):
        raise error(place, "entries that are masked", "numbers all of which are known")
    if given.dtype.kind not in "iuf":
        raise error(place, value, f"numbers of shape {wanted}" if shape else "a number")
    array = given.astype(np.float64, order="C")
    fits = array.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        raise error(place, f"shape {array.shape}", f"shape {wanted}")
    usable = np.abs(array) <= LARGEST
    if not usable.all():
        index = tuple(int(i) for i in np.argwhere(~usable)[0])
        where = f"{place}{list(index)}" if index else place
        raise error(where, float(array[index]), f"finite numbers up to {LARGEST:g}")
    array.setflags(write=False)
    return array
