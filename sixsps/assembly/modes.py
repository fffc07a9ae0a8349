"""What `assembly_modes` returns: the poses, and what is known of those that are not among them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import overload

from sixsps.arrays import Array
from sixsps.pose import Pose

PROVEN, COUNTED, FOLLOWED, OPEN = "proven", "counted", "followed", "open"


@dataclass(frozen=True, eq=False)
class AssemblyMode(Pose):
    """One pose with the given leg lengths, proven to exist.

    Attributes:
        position: (3,) platform origin O1, world frame [m].
        quaternion: (4,) orientation w, x, y, z, of unit length, the first entry that is not zero positive.
        residual: largest |length - given length| at this pose, as computed in float64 [m].
        position_radius: the true pose's position is proven to be at most this far away [m].
        rotation_radius: its orientation is at most this angle away [rad].
    """

    residual: float
    position_radius: float
    rotation_radius: float


@dataclass(frozen=True, eq=False)
class SingularMode(Pose):
    """A pose at which the legs do not hold the platform; found, not proven.

    Its lengths are the given ones; where it was found next to complex solutions alone (`split`), they differ
    from these by no more than the rounding of lengths computed at it.

    Attributes:
        position: (3,) platform origin O1, world frame [m].
        quaternion: (4,) orientation w, x, y, z.
        residual: largest |length - given length| [m].
        multiplicity: how many solutions come together here.
        dimension: of the set of poses with these lengths around this one: 0 where it is isolated.
        split: how many of these solutions are kept from being real and here by rounding of the lengths alone;
            they are certified ones that are not real, and counted by `AssemblyModes.certified`, too.
    """

    residual: float
    multiplicity: int
    dimension: int
    split: int = 0


@dataclass(frozen=True, eq=False)
class AssemblyModes(Sequence[AssemblyMode]):
    """Every pose with the given leg lengths: a sequence of `AssemblyMode`, and their arrays.

    Attributes:
        position: (k, 3) [m].
        quaternion: (k, 4) w, x, y, z.
        rotation: (k, 3, 3) platform axes to world axes.
        residual: (k,) [m].
        position_radius: (k,) [m].
        rotation_radius: (k,) [rad].
        pattern: which legs share anchors, as the literature writes it: 6-6, 6-3.
        expected: complex solutions of the mechanism with generic lengths, those at infinity not counted.
        certified: solutions that are proven to exist and to differ, the poses among them; each of the others
            is proven not to be real.
        at_infinity: paths that led to no pose: the platform went to infinity.
        always_at_infinity: solutions that other mechanisms have whose legs share anchors alike, and that
            these anchors send to infinity whatever the lengths, as paths show; not among those expected.
        singular: isolated real poses where solutions come together, but for rounding of the lengths.
        non_isolated: one pose for each path that ended in a set of poses with these lengths: the platform
            can move. Several may belong to one set.
        complex_singular: paths that came together at poses that are not real.
        complex_non_isolated: paths that ended in sets of solutions in which no real one was found.
        unresolved: solutions of which nothing is known; 0 unless the computation failed.
    """

    position: Array
    quaternion: Array
    rotation: Array
    residual: Array
    position_radius: Array
    rotation_radius: Array
    pattern: str
    expected: int
    certified: int
    at_infinity: int = 0
    always_at_infinity: int = 0
    singular: tuple[SingularMode, ...] = ()
    non_isolated: tuple[SingularMode, ...] = ()
    complex_singular: int = 0
    complex_non_isolated: int = 0
    unresolved: int = 0
    bound: int = field(default=40, repr=False)

    @property
    def proof(self) -> str:
        """What it rests on that there are no more isolated poses.

        `proven`: as many different solutions are certified as any hexapod has at most, 40.
        `counted`: as many are certified as generic mechanisms have whose legs share anchors alike; that
            number is computed (by monodromy, and from the general class), not proven.
        `followed`: what is missing of that number was followed, numerically, to infinity or a singular pose:
            with these lengths, or with all lengths where the anchors are special.
        `open`: solutions are unaccounted for, or the anchors are so nearly special that it is not known.
        """
        if self.certified >= self.bound:
            return PROVEN
        if self.unresolved:
            return OPEN
        counted = self.certified >= self.expected and not self.always_at_infinity
        return COUNTED if counted else FOLLOWED

    @property
    def complete(self) -> bool:
        """Whether every isolated pose is accounted for; `proof` says on what that rests."""
        return self.proof != OPEN

    def __len__(self) -> int:
        return len(self.position)

    @overload
    def __getitem__(self, index: int) -> AssemblyMode: ...
    @overload
    def __getitem__(self, index: slice) -> list[AssemblyMode]: ...
    def __getitem__(self, index: int | slice) -> AssemblyMode | list[AssemblyMode]:
        """Returns one pose, or a list of them."""
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"assembly mode {index} of {len(self)}")
        numbers = (self.residual, self.position_radius, self.rotation_radius)
        return AssemblyMode(
            self.position[index], self.quaternion[index], *(float(array[index]) for array in numbers)
        )

    def __iter__(self) -> Iterator[AssemblyMode]:
        return (self[k] for k in range(len(self)))
