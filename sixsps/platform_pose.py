"""Forward kinematics: leg lengths to the pose of the platform, and rates of lengths to its motion."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixsps.arguments import mechanism_of, whole_number
from sixsps.arrays import Array, frozen
from sixsps.errors import ConvergenceError, InputError, MotionError
from sixsps.pose import Pose

if TYPE_CHECKING:
    from sixsps.kernels.poses import Found, PoseFinder
    from sixsps.mechanism import Mechanism
    from sixsps.motion import Motion

STATUSES = ("ok", "unreachable", "unreachable", "singular", "singular", "limit")
"""By what the kernel says: found, impossible, blocked, from and at a singular pose, out of iterations."""
MOST_ITERATIONS = 2000
# What the kernel counts to, with a factor of two to spare.
_LARGEST_COUNT = 2**30
_OK, _IMPOSSIBLE, _INVALID = 0, 1, len(STATUSES)
_HELP = "sixsps.assembly_modes gives every pose with these lengths"
_BLOCKED = (
    "no pose was found from the guess: on the straight way of squared lengths to these the platform comes to "
    "a singular pose, at which a length is still {residual:.3g} m off; another guess may lead there: "
    f"{_HELP}"
)
_MESSAGES = (
    "",
    "no pose has such lengths: {pair}",
    _BLOCKED,
    f"the guess is a singular pose, from which nothing leads on for certain; start elsewhere: {_HELP}",
    "the lengths are those of a singular pose as far as float64 can tell, where two solutions meet; "
    "the last iterate has them within {residual:.3g} m",
    "{iterations} iterations lead no nearer than {residual:.3g} m; start nearer, allow more by "
    f"max_iterations, or: {_HELP}",
)


@dataclass(frozen=True, eq=False)
class ForwardKinematics:
    """The pose of one sample, or the poses of n.

    Where the status is not `ok` no pose was found from the guess: position and quaternion are NaN. It is
    `unreachable` where two of the legs can never have such lengths at once, or where the way from the guess
    ends at a singular pose before; `singular` where the guess is a singular pose, or the lengths are those of
    one; `limit` where it took too many iterations. Only of the first, `proven_impossible`, there is no pose;
    of the others `assembly_modes` tells.

    Attributes:
        mechanism: what has these lengths.
        lengths: (6,) or (n, 6) wanted lengths [m].
        position: (3,) or (n, 3) platform origin O1, world frame [m].
        quaternion: (4,) or (n, 4) orientation w, x, y, z, of unit length; its sign that which is nearer to
            the guess, or to the sample before.
        iterations: () or (n,) Newton steps, those on the way included.
        residual: () or (n,) how far the lengths of the last iterate are from those wanted, at most [m].
    """

    mechanism: Mechanism = field(repr=False)
    lengths: Array
    position: Array
    quaternion: Array
    iterations: NDArray[np.int32]
    residual: Array
    _reason: NDArray[np.uint8] = field(repr=False)

    @cached_property
    def status(self) -> Any:
        """`ok`, `unreachable`, `singular` or `limit`; of n samples an array (n,) of them."""
        return np.array(STATUSES)[self._reason] if self._reason.ndim else STATUSES[int(self._reason)]

    @cached_property
    def ok(self) -> Any:
        """Whether a pose was found; of n samples an array (n,)."""
        return self._reason == _OK if self._reason.ndim else bool(self._reason == _OK)

    @cached_property
    def proven_impossible(self) -> Any:
        """Whether two legs break the triangle inequality, so that no pose has such lengths; or (n,) of them.

        Where it is false and no pose was found, there may be some that this guess does not lead to.
        """
        return self._reason == _IMPOSSIBLE if self._reason.ndim else bool(self._reason == _IMPOSSIBLE)

    @cached_property
    def rotation(self) -> Array:
        """(3, 3) or (n, 3, 3) platform axes to world axes."""
        w, *xyz = np.moveaxis(self.quaternion, -1, 0)
        vector = np.stack(xyz, axis=-1)
        outer = 2 * vector[..., :, None] * vector[..., None, :]
        x, y, z = (2 * w * one for one in xyz)
        zero = np.zeros_like(x)
        skewed = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(outer.shape)
        diagonal = 1 - 2 * np.sum(vector * vector, axis=-1)
        return np.asarray(outer + skewed + diagonal[..., None, None] * np.eye(3))

    def motion(
        self,
        time: ArrayLike,
        length_rates: ArrayLike | None = None,
        length_accelerations: ArrayLike | None = None,
        *,
        cutoff: float | None = None,
        name: str = "motion",
    ) -> Motion:
        """Returns the motion through these poses.

        Args:
            time: (n,) strictly increasing [s].
            length_rates: (n, 6) [m/s]; the twist that they make is the motion's.
            length_accelerations: (n, 6) [m/s^2], only with rates; the acceleration that they make likewise.
            cutoff: corner frequency of the smoothing of what is not given [Hz]; from the data by default.
            name: what to call it in reports.

        Raises:
            MotionError: a sample without a pose, or as `Motion.from_poses`.
            InputError: rates of other shapes, or accelerations without rates.
        """
        from sixsps.differentiation import complete
        from sixsps.platform_rates import forward_rates

        if self.position.ndim != 2:
            raise InputError("lengths", f"shape {self.lengths.shape}", "shape (n, 6), for a motion")
        if not self.ok.all():
            sample = int(np.argmin(self.ok))
            raise MotionError(f"sample {sample}", self.status[sample], "ok, for a motion")
        arrays = {"time": frozen(time, (len(self.position),), "time", MotionError)}
        arrays |= {"position": self.position, "quaternion": self.quaternion}
        if length_rates is not None:
            found = forward_rates(self.mechanism, self, length_rates, length_accelerations)
            arrays |= {key: value for key, value in found.arrays.items() if value is not None}
        elif length_accelerations is not None:
            raise InputError("length_rates", None, "(n, 6) length rates with length accelerations")
        return complete(arrays, cutoff, name)


def forward_kinematics(
    mechanism: Mechanism,
    lengths: ArrayLike,
    guess: Any = None,
    *,
    on_failure: Literal["raise", "return"] = "raise",
    max_iterations: int = MOST_ITERATIONS,
    threads: int | None = None,
) -> ForwardKinematics:
    """Returns the pose that leg lengths lead the platform to.

    A hexapod has up to 40 poses with the same leg lengths. This is the one that the legs lead to from the
    guess, or from the last sample that was found, while all their squared lengths change in proportion.
    Every step on that way is covered by the theorem of Newton and Kantorovich, with a bound on the curvature
    of the equations at the place (`sixsps.kernels.pose_equations`): the poses of the way hang together, none
    of them is singular, det J keeps its sign, and no other assembly mode is taken for the one at its end.
    Bounds are evaluated in float64, with a tenth of room and the rounding of the lengths allowed for.

    What that does not say: a mechanism that can go around a cusp has two poses with the same lengths that
    hang together by regular ones; which of them is found depends on the way, and the platform's own may have
    been another. And where the way comes to a singular pose it ends, though a pose with these lengths may be
    there and another way lead to it. Along a trajectory only the way from one sample to the next matters.

    A pose is as accurate as its lengths: off by their rounding times the condition number of the Jacobian.
    Where that is beyond some 1e7, rounding hides which of two poses is meant, and the status is `singular`.

    The first call on a machine compiles for some seconds; the machine code is kept on disk.
    `sixsps.compile(mechanism).forward_kinematics` does the same with less to do at each call.

    Args:
        mechanism: its geometry is all that is needed.
        lengths: (6,) of one sample, or (n, 6) [m].
        guess: where the platform is before the first sample: anything that `Pose.of` takes; or n poses, as
            a motion or state of n samples, one for each sample; the home position by default, orientation
            identity. From a single guess each sample is reached from the last one that was found.
        on_failure: `raise` where no pose was found, or `return` what was, with status and residual.
        max_iterations: Newton steps that a sample may take.
        threads: that a long array is shared among; the number of processors by default. No bit of the
            result depends on it.

    Raises:
        ConvergenceError: no pose was found for a sample; says which, whether it is proven that there is none,
            and what to do.
        InputError: not a mechanism, lengths or options that are none, lengths that are negative or not
            finite, a guess of another shape, or no guess where the mechanism has no length limits and so no
            home position.
    """
    from sixsps.kernels.poses import PoseFinder
    from sixsps.kernels.sharing import thread_count

    finder = PoseFinder(mechanism_of(mechanism), thread_count(threads))
    return solved(finder, lengths, guess, on_failure, max_iterations)


def solved(
    finder: PoseFinder, lengths: ArrayLike, guess: Any, on_failure: str, max_iterations: int
) -> ForwardKinematics:
    """Returns what a finder makes of lengths; see `forward_kinematics`."""
    most, found = _most_iterations(on_failure, max_iterations), None
    if type(lengths) is np.ndarray and lengths.shape == (6,) and lengths.dtype == np.float64:
        # A control loop's call: whether these are lengths and a pose is left to the kernel.
        wanted = lengths.copy()
        found = finder.one(wanted, finder.home if guess is None else _numbers(guess), most)
    if found is None or found.reason[0] == _INVALID:
        wanted = _lengths(lengths)
        found = _found(finder, wanted, guess, most)
    if on_failure == "raise" and found.reason.any():
        raise _failure(finder.mechanism, wanted, found)
    arrays = (found.position, found.quaternion, found.iterations, found.residual, found.reason)
    if wanted.ndim == 1:
        return ForwardKinematics(finder.mechanism, wanted, *(array[0] for array in arrays))
    return ForwardKinematics(finder.mechanism, wanted, *arrays)


def _found(finder: PoseFinder, wanted: Array, guess: Any, max_iterations: int) -> Found:
    rows = wanted.reshape(-1, 6)
    guesses = _several(guess, len(rows)) if wanted.ndim == 2 else None
    if guesses is not None:
        return finder.each(rows, guesses, max_iterations)
    first = finder.home if guess is None else _numbers(Pose.of(guess))
    return finder.along(rows, first, max_iterations)


def _most_iterations(on_failure: str, max_iterations: int) -> int:
    """Returns the number of iterations, where the options are some."""
    if on_failure not in ("raise", "return"):
        raise InputError("on_failure", on_failure, "raise or return")
    return whole_number(max_iterations, "max_iterations", 1, _LARGEST_COUNT)


def _lengths(given: ArrayLike) -> Array:
    try:
        several = np.ndim(given) > 1
    except ValueError:  # rows of different lengths, which `frozen` refuses
        several = True
    lengths = frozen(given, (None, 6) if several else (6,), "lengths", InputError)
    if (lengths < 0).any():
        index = tuple(int(i) for i in np.argwhere(lengths < 0)[0])
        raise InputError(f"lengths{list(index)}", float(lengths[index]), "lengths of at least 0 [m]")
    return lengths


def _numbers(guess: Any) -> Array:
    """Returns the (7,) position and quaternion of a guess; those of a pose as they are."""
    known = isinstance(guess, Pose) or (isinstance(guess, ForwardKinematics) and guess.position.ndim == 1)
    pose = guess if known else Pose.of(guess)
    return np.concatenate([pose.position, pose.quaternion])


def _several(guess: Any, n: int) -> Array | None:
    """Returns the (n, 7) poses of a guess that has one for every sample; None where it has a single one."""
    position, quaternion = _parts(guess)
    if np.ndim(position) != 2 or len(position) == 1 != n:
        return None
    if len(position) != n:
        raise InputError("guess", f"{len(position)} poses", f"one pose, or one for each of {n} samples")
    positions = frozen(position, (n, 3), "guess.position", InputError)
    quaternions = frozen(quaternion, (n, 4), "guess.quaternion", InputError)
    if not (np.linalg.norm(quaternions, axis=1) > 0).all():
        raise InputError("guess.quaternion", "length 0", "lengths above 0")
    return np.hstack([positions, quaternions])


def _parts(guess: Any) -> tuple[Any, Any]:
    if hasattr(guess, "position"):
        return guess.position, getattr(guess, "quaternion", None)
    return tuple(guess) if isinstance(guess, tuple | list) and len(guess) == 2 else (None, None)


def _failure(mechanism: Mechanism, wanted: Array, found: Found) -> ConvergenceError:
    failed = np.flatnonzero(found.reason)
    first = int(failed[0])
    reason = int(found.reason[first])
    lengths = wanted.reshape(-1, 6)[first]
    why = _MESSAGES[reason].format(
        residual=found.residual[first],
        iterations=found.iterations[first],
        pair=_pair(mechanism, lengths) if reason == _IMPOSSIBLE else "",
    )
    where = f"sample {first}: " if wanted.ndim == 2 else ""
    more = f" (none found for {len(failed)} of {len(found.reason)} samples)" if len(failed) > 1 else ""
    return ConvergenceError(STATUSES[reason], f"{where}{why}{more}")


def _pair(mechanism: Mechanism, lengths: Array) -> str:
    """Says of the two legs that are most at odds by the triangle inequality why they are."""
    A, b = mechanism.base_anchors, mechanism.platform_anchors
    first, second = np.triu_indices(6, 1)
    base, platform = (np.linalg.norm(x[first] - x[second], axis=1) for x in (A, b))
    one, other = lengths[first], lengths[second]
    apart = np.abs(one - other) - (base + platform)
    short = np.abs(base - platform) - (one + other)
    pair = int(np.argmax(np.maximum(apart, short)))
    legs = f"legs {first[pair] + 1} and {second[pair] + 1} of {one[pair]:.6g} and {other[pair]:.6g} m"
    if apart[pair] >= short[pair]:
        return f"{legs} differ by more than the {base[pair] + platform[pair]:.6g} m between their anchors"
    return f"{legs} are together shorter than the {abs(base[pair] - platform[pair]):.6g} m they have to span"
