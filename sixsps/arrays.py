"""The one array type of this project, and the freezing of inputs."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixsps.errors import InputError

Array = NDArray[np.float64]


def frozen(
    value: ArrayLike, shape: Sequence[int | None], place: str, error: Callable[..., InputError]
) -> Array:
    """Returns a read-only float64 copy of `value` after checking its shape and that it is finite.

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
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise error(place, value, f"numbers of shape {wanted}") from None
    fits = array.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        raise error(place, f"shape {array.shape}", f"shape {wanted}")
    if not np.isfinite(array).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise error(f"{place}{list(index)}", float(array[index]), "finite numbers")
    array.setflags(write=False)
    return array
