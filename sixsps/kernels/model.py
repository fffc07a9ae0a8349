"""A mechanism as machine code: leg forces, their derivatives and leg motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from itertools import chain
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from sixsps.arguments import mechanism_of
from sixsps.arrays import Array
from sixsps.errors import InputError, MotionError
from sixsps.kernels.compiled import MISFIT, REGULAR, Kernel, kernel
from sixsps.kernels.emission import CAPACITY
from sixsps.kernels.sharing import shared, thread_count
from sixsps.kernels.signatures import (
    EQUATIONS,
    FORCE_DERIVATIVES,
    FORCES,
    LEG_MOTION,
    PARAMETER_DERIVATIVES,
    Signature,
)
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.parameters import parameter_vector
from sixsps.platform_pose import MOST_ITERATIONS, ForwardKinematics, solved
from sixsps.singularity import SINGULAR_CONDITION, condition_numbers

if TYPE_CHECKING:
    from sixsps.kernels.poses import PoseFinder

# A chunk takes some tenths of a millisecond: long beside handing it out, and every thread gets its share.
_CHUNK, _LEAST_CHUNK = 8192, 2048
# What is looked at anew where a chunk has a doubtful sample.
_PART = 64
_DOUBLE = np.dtype(np.float64)
_NOTHING = np.zeros(3)
_ARRAYS = tuple(FORCES.arrays)
_BLOCKS = ("by_pose", "by_twist", "by_acceleration", "by_wrench")


@dataclass(frozen=True, eq=False)
class ForceDerivatives:
    """Leg forces and their exact derivatives at n samples; NaN where the pose is singular.

    Attributes:
        forces: (n, 6) [N].
        by_pose: (n, 6, 6) with respect to [dp; dtheta]: the pose is perturbed to
            (P + dp, exp([dtheta]x) R), world axes, the rest keeps its components [N/m, N/rad].
        by_twist: (n, 6, 6) with respect to [velocity; angular_velocity] [N s/m, N s].
        by_acceleration: (n, 6, 6) with respect to [acceleration; angular_acceleration] [kg, kg m].
        by_wrench: (n, 6, 6) with respect to the external [force; moment] [1, 1/m].
    """

    forces: Array
    by_pose: Array
    by_twist: Array
    by_acceleration: Array
    by_wrench: Array


@dataclass(frozen=True, eq=False)
class LegLengths:
    """Motion along the legs at n samples.

    Attributes:
        lengths: (n, 6) [m].
        length_rates: (n, 6) [m/s].
        length_accelerations: (n, 6) [m/s^2].
    """

    lengths: Array
    length_rates: Array
    length_accelerations: Array


class CompiledMechanism:
    """What `sixsps.compile` returns: kernels with the constants of one mechanism.

    All methods may be called from several threads at once; `leg_forces` may be, each with an array of
    its own for the result.
    """

    def __init__(self, mechanism: Mechanism, threads: int | None = None) -> None:
        self.mechanism = mechanism
        self.threads = thread_count(threads)
        self._parameters = parameter_vector(mechanism)
        self._constants: dict[Signature, Array] = {}
        self._fixed = self._constants_of(kernel(FORCES))
        self._single = kernel(FORCES).single if mechanism.has_inertia else self._refuse
        for signature in (EQUATIONS, LEG_MOTION):  # what judges the first doubtful pose, in a control loop
            self._constants_of(kernel(signature))

    def __reduce__(self) -> tuple[type[CompiledMechanism], tuple[Mechanism, int]]:
        """Pickles as what it was made from; the other process has its own machine code."""
        return CompiledMechanism, (self.mechanism, self.threads)

    def inverse_dynamics(self, motion: Motion, out: Array | None = None) -> Array:
        """Returns the (n, 6) leg forces along a motion [N]; NaN where the pose is singular.

        Args:
            motion: n samples.
            out: (n, 6) array for the result, C-contiguous float64; a new one by default.
        """
        forces = np.empty((len(motion), 6)) if out is None else _checked(out, (len(motion), 6))
        self._run(FORCES, motion, {"F": forces})
        return forces

    def inverse_dynamics_derivatives(
        self, motion: Motion, out: ForceDerivatives | None = None
    ) -> ForceDerivatives:
        """Returns the leg forces along a motion with their exact derivatives.

        Args:
            motion: n samples.
            out: of n samples, for the result; new arrays by default, which take their time: 1200 bytes
                a sample.
        """
        outputs = None
        if out is not None:
            given = {"F": out.forces} | {name: getattr(out, name) for name in _BLOCKS}
            shapes = FORCE_DERIVATIVES.outputs
            outputs = {name: _checked(array, (len(motion), *shapes[name])) for name, array in given.items()}
        found = self._run(FORCE_DERIVATIVES, motion, outputs)
        return ForceDerivatives(found["F"], **{name: found[name] for name in _BLOCKS})

    def parameter_derivatives(self, motion: Motion) -> Array:
        """Returns the (n, 6, 97) exact derivatives of the forces by `sixsps.symbolic.PARAMETERS`."""
        return self._run(PARAMETER_DERIVATIVES, motion)["by_parameters"]

    def equations(self, motion: Motion) -> tuple[Array, Array]:
        """Returns J (n, 6, 6) and C (n, 6) of J F = C; singular poses like any other."""
        found = self._run(EQUATIONS, motion)
        return found["J"], found["C"]

    def inverse_kinematics(self, motion: Motion) -> LegLengths:
        """Returns lengths of the legs along a motion with their first two derivatives."""
        return LegLengths(**self._run(LEG_MOTION, motion))

    def forward_kinematics(
        self,
        lengths: ArrayLike,
        guess: Any = None,
        *,
        on_failure: Literal["raise", "return"] = "raise",
        max_iterations: int = MOST_ITERATIONS,
    ) -> ForwardKinematics:
        """Returns the pose that leg lengths lead the platform to; see `sixsps.forward_kinematics`.

        The first call of a process reads its machine code from disk. In a control loop the guess is what
        the call before returned: from there it takes some 16 microseconds.

        Args:
            lengths: (6,) of one sample, or (n, 6) [m].
            guess: where the platform is before the first sample, or n poses; the home position by default.
            on_failure: `raise` where no pose was found, or `return` what was found, with its status.
            max_iterations: Newton steps that a sample may take.

        Raises:
            ConvergenceError, InputError: as `sixsps.forward_kinematics`.
        """
        return solved(self._finder, lengths, guess, on_failure, max_iterations)

    @cached_property
    def _finder(self) -> PoseFinder:
        from sixsps.kernels.poses import PoseFinder  # machine code that forces do not take

        return PoseFinder(self.mechanism, self.threads)

    def leg_forces(
        self,
        position: ArrayLike,
        quaternion: ArrayLike,
        velocity: ArrayLike = _NOTHING,
        angular_velocity: ArrayLike = _NOTHING,
        acceleration: ArrayLike = _NOTHING,
        angular_acceleration: ArrayLike = _NOTHING,
        force: ArrayLike = _NOTHING,
        moment: ArrayLike = _NOTHING,
        out: Array | None = None,
    ) -> Array:
        """Returns the (6,) leg forces of one sample [N]; NaN where the pose is singular.

        Made for control loops: with C-contiguous float64 arrays it takes a few microseconds, and with
        `out` it allocates nothing that stays. Values are taken as they are: a NaN gives NaN, and a
        quaternion may have any length from 1e-150 to 1e150.

        Args:
            position: (3,) of O1 [m].
            quaternion: (4,) w, x, y, z.
            velocity: (3,) of O1 [m/s]; this and what follows is 0 by default.
            angular_velocity: (3,) world axes [rad/s].
            acceleration: (3,) of O1 [m/s^2].
            angular_acceleration: (3,) world axes [rad/s^2].
            force: (3,) external, on the platform's centre of mass [N].
            moment: (3,) external [N m].
            out: (6,) array for the result, C-contiguous float64; a new one by default.

        Raises:
            InputError: an array has another shape, or holds no real numbers.
        """
        forces = np.empty(6) if out is None else out
        given = (
            position, quaternion, velocity, angular_velocity,
            acceleration, angular_acceleration, force, moment,
        )  # fmt: skip
        arrays = _arrays(given)
        if out is not None and getattr(out, "dtype", None) != _DOUBLE:
            raise _misfit(arrays, forces)
        try:
            answer = self._single(arrays, self._fixed, (forces,))
        except TypeError:  # not vectors, or no array for the result
            answer = MISFIT
        if answer == REGULAR:
            return forces
        if answer == MISFIT:
            raise _misfit(arrays, forces)
        return self._judged(arrays, forces)

    def _refuse(self, *_arrays: Any) -> int:
        """Stands for the kernel of forces where the mechanism is geometry alone."""
        self.mechanism.check_inertia()
        raise AssertionError("a mechanism with inertia was refused")

    def _run(
        self, signature: Signature, motion: Motion, outputs: dict[str, Array] | None = None
    ) -> dict[str, Array]:
        """Evaluates a kernel along a motion, a long one on all threads; NaN at singular samples."""
        if signature is not LEG_MOTION:
            self.mechanism.check_inertia()
        one, n = kernel(signature), len(motion)
        arrays = {name: np.ascontiguousarray(getattr(motion, name)) for name in signature.arrays}
        found = outputs or {name: np.empty((n, *shape)) for name, shape in signature.outputs.items()}
        flat = tuple(array.reshape(n, -1) if n else array.reshape(0, 1) for array in found.values())
        call = partial(one.batch, tuple(arrays.values()), self._constants_of(one), flat)
        size = max(_LEAST_CHUNK, min(_CHUNK, n // (8 * self.threads)))
        starts = range(0, n, size)

        def chunk(start: int) -> list[slice]:
            """Evaluates a chunk and returns the parts of it in which a sample may be singular."""
            stop = min(start + size, n)
            if call(start, stop):
                return []
            parts = [slice(first, min(first + _PART, stop)) for first in range(start, stop, _PART)]
            return [part for part in parts if not call(part.start, part.stop)]

        doubtful = shared(chunk, starts, self.threads)
        for part in chain.from_iterable(doubtful):
            self._blank_singular(motion, part, found)
        return found

    def _constants_of(self, one: Kernel) -> Array:
        if one.signature not in self._constants:
            fixed = np.empty(CAPACITY)
            one.prepare(self._parameters, fixed)
            self._constants[one.signature] = fixed
        return self._constants[one.signature]

    def _blank_singular(self, motion: Motion, samples: slice, found: dict[str, Array]) -> None:
        """Puts NaN where a pose of a doubtful chunk is singular, by the definition of all formulations."""
        part = motion[samples]
        J, _ = self.equations(part)
        lengths = self.inverse_kinematics(part).lengths
        condition = condition_numbers(J.swapaxes(1, 2), lengths, self.mechanism.characteristic_length)
        singular = ~(condition <= SINGULAR_CONDITION)
        for array in found.values():
            array[samples][singular] = np.nan

    def _judged(self, given: tuple[Array, ...], forces: Array) -> Array:
        """Puts NaN into the forces of one sample where it is singular, or no state of motion at all."""
        columns: dict[str, Any] = {
            name: value[None] for name, value in zip(FORCES.arrays, given, strict=True)
        }
        largest = np.abs(columns["quaternion"]).max()
        if not 0 < largest < np.inf:
            forces[:] = np.nan
            return forces
        turned = columns["quaternion"] / largest
        columns["quaternion"] = turned / np.linalg.norm(turned)
        try:
            motion = Motion(time=np.zeros(1), **columns)
        except MotionError:
            forces[:] = np.nan
        else:
            self._blank_singular(motion, slice(0, 1), {"F": forces[None]})
        return forces


def compile(mechanism: Mechanism, threads: int | None = None) -> CompiledMechanism:  # noqa: A001
    """Returns a mechanism's forces, derivatives and leg motion as machine code.

    The first call on a machine compiles for a few seconds, and so does the first that asks for
    derivatives; the machine code is kept on disk, and no C compiler is needed. A mechanism's numbers are
    inputs of the code: another mechanism compiles nothing.

    Args:
        mechanism: geometry and inertia; geometry alone has leg motion only.
        threads: that a long motion is shared among; the number of processors by default.

    Raises:
        InputError: `threads` is not a positive number, or `mechanism` is no `Mechanism`.
    """
    return CompiledMechanism(mechanism_of(mechanism), threads)


def _arrays(given: tuple[ArrayLike, ...]) -> tuple[Array, ...]:
    """Returns what is given as contiguous arrays; what is one already, as it is."""
    made = []
    for name, value in zip(_ARRAYS, given, strict=True):
        if type(value) is not np.ndarray or value.dtype is not _DOUBLE:
            value = _numbers(name, value)
        made.append(np.ascontiguousarray(value))
    return tuple(made)


def _numbers(name: str, value: ArrayLike) -> Array:
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        array = np.array(None)
    if array.dtype.kind not in "iuf":
        raise InputError(name, value, f"{FORCES.arrays[name]} numbers")
    return array.astype(np.float64)


def _checked(out: Array, shape: tuple[int, ...]) -> Array:
    usable = isinstance(out, np.ndarray) and out.dtype == np.float64 and out.shape == shape
    if not (usable and out.flags.c_contiguous and out.flags.writeable):
        raise InputError("out", type(out).__name__, f"a writable C-contiguous float64 array of shape {shape}")
    return out


def _misfit(given: tuple[Array, ...], forces: Array) -> InputError:
    """Returns the error that names the array that a kernel has refused."""
    for (name, size), value in zip(FORCES.arrays.items(), given, strict=True):
        if value.shape != (size,):
            return InputError(name, f"shape {value.shape}", f"shape ({size},)")
    _checked(forces, (6,))
    raise AssertionError("a kernel has refused arrays that fit")
