"""Slopes of the balance of wrenches C - J F by pose, twist and acceleration of the platform, F held.

A point of the platform at the arm c moves, when the pose is perturbed by [dp; dtheta], by

    dB = dp + dtheta x c,   dB' = omega x (dtheta x c),   dB'' = epsilon x (..) + omega x (omega x (..)),

and dB' = dv + domega x c and so on when twist and acceleration are. A leg takes at its joint the force
w whose slopes `leg.py` gives as  equal E + V inner V^T.  Three things keep the sum over the legs short:

- what a leg takes along its own line changes the force of its own actuator and no other, because
  J^-1 [s; c x s] is a unit vector: these parts are rows of the result and never meet J^-1;
- the parts with `equal` are those of point masses: sums of 1, c and c c^T are all they need;
- what is left are outer products of a wrench and a row.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from sixsps.symbolic.leg import LegSlopes

NAMES = ("by_pose", "by_twist", "by_acceleration")
_E = ca.SX.eye(3)
_UPPER = [0, 3, 4, 6, 7, 8]  # of a (3, 3) matrix, columns first


@dataclass(frozen=True, eq=False)
class Slopes:
    """Matrices (rows, 6) with respect to pose, twist and acceleration of the platform.

    The pose is perturbed to (P + dp, exp([dtheta]x) R); the others keep their world components.
    """

    by_pose: ca.SX
    by_twist: ca.SX
    by_acceleration: ca.SX

    def __add__(self, other: Slopes) -> Slopes:
        return Slopes(*(getattr(self, name) + getattr(other, name) for name in NAMES))

    def all(self) -> list[ca.SX]:
        """Returns the three matrices in the order of `NAMES`."""
        return [getattr(self, name) for name in NAMES]

    def packed(self) -> ca.SX:
        """Returns the entries of the three matrices as a column."""
        return ca.vertcat(*(ca.vec(ca.densify(matrix)) for matrix in self.all()))

    @classmethod
    def unpacked(cls, column: ca.SX, rows: int) -> Slopes:
        """Returns the matrices (rows, 6) that `packed` has written."""
        return cls(*(ca.reshape(part, rows, 6) for part in ca.vertsplit(column, 6 * rows)))


@dataclass(frozen=True, eq=False)
class Points:
    """Sums over points of the platform that take  a dB + b dB' + d dB''  of their own motion.

    Attributes:
        first: of a, b, d: (3,).
        arms: of a c, b c, d c: three (3,).
        squares: of a c c^T and so on: three (3, 3).
        moments: of c w^T, w being the force at the point: (3, 3).
    """

    first: ca.SX
    arms: tuple[ca.SX, ...]
    squares: tuple[ca.SX, ...]
    moments: ca.SX

    @classmethod
    def one(cls, arm: ca.SX, equal: tuple[ca.SX, ca.SX, ca.SX], force: ca.SX) -> Points:
        """Returns the sums of a single point.

        Args:
            arm: (3,) c, from O1.
            equal: a, b, d.
            force: (3,) w.
        """
        arms = tuple(factor * arm for factor in equal)
        squares = tuple(ca.triu(scaled @ arm.T) for scaled in arms)
        return cls(ca.vertcat(*equal), arms, squares, arm @ force.T)

    def __add__(self, other: Points) -> Points:
        arms = tuple(a + b for a, b in zip(self.arms, other.arms, strict=True))
        squares = tuple(a + b for a, b in zip(self.squares, other.squares, strict=True))
        return Points(self.first + other.first, arms, squares, self.moments + other.moments)

    SIZE = 3 + 9 + 18 + 9
    """Numbers that `packed` takes."""

    def packed(self) -> ca.SX:
        """Returns all sums as a column (SIZE,)."""
        upper = [ca.densify(square)[_UPPER] for square in self.squares]
        return ca.vertcat(self.first, *self.arms, *upper, ca.vec(self.moments))

    @classmethod
    def unpacked(cls, column: ca.SX) -> Points:
        """Returns the sums that `packed` has written."""
        first, *rest = ca.vertsplit(column, [0, 3, 6, 9, 12, 18, 24, 30, cls.SIZE])
        squares = tuple(_upper(entries) for entries in rest[3:6])
        return cls(first, tuple(rest[:3]), squares, ca.reshape(rest[6], 3, 3))

    def slopes(self, omega: ca.SX, epsilon: ca.SX) -> Slopes:
        """Returns the slopes (6, 6) of the wrench of all points, their arms turning with the platform."""
        a, b, d = ca.vertsplit(self.first)
        arm_a, arm_b, arm_d = (ca.skew(arm) for arm in self.arms)
        square_a, square_b, square_d = (ca.triu2symm(square) for square in self.squares)
        across_a, across_b, across_d = (_across(square) for square in (square_a, square_b, square_d))
        turning = ca.skew(omega)
        # [c]x [omega]x [c]x = -(c.omega) [c]x, and [c]x omega omega^T [c]x = [omega]x c c^T [omega]x.
        pose_force = -(arm_a + turning @ arm_b + (ca.skew(epsilon) + turning @ turning) @ arm_d)
        pose_moment = (
            -across_a
            + ca.skew(square_b @ omega + square_d @ epsilon)
            - turning @ square_d @ turning
            + ca.dot(omega, omega) * across_d
            + self.moments
            - ca.trace(self.moments) * _E
        )
        spun = ca.cross(omega, self.arms[2])
        twist_force = -(arm_b + ca.skew(spun) + turning @ arm_d)
        twist_moment = -across_b - turning @ square_d + ca.skew(square_d @ omega)
        return Slopes(
            ca.blockcat([[a * _E, pose_force], [arm_a, pose_moment]]),
            ca.blockcat([[b * _E, twist_force], [arm_b, twist_moment]]),
            ca.blockcat([[d * _E, -arm_d], [arm_d, -across_d]]),
        )


def _upper(entries: ca.SX) -> ca.SX:
    square = ca.SX(3, 3)
    for place, entry in zip(_UPPER, ca.vertsplit(entries), strict=True):
        square[place] = entry
    return square


def _across(square: ca.SX) -> ca.SX:
    """Sum of [c]x [c]x from that of c c^T."""
    return square - ca.trace(square) * _E


class JointMotion:
    """How the motion of a platform joint depends on the platform's.

    Attributes:
        arm: (3,) c, from O1.
    """

    def __init__(self, arm: ca.SX, omega: ca.SX, epsilon: ca.SX) -> None:
        self.arm, self._omega, self._epsilon = arm, omega, epsilon

    def row(self, by_position: ca.SX, by_velocity: ca.SX, by_acceleration: ca.SX) -> Slopes:
        """Returns the slopes (1, 6) of a number with these gradients (3,) by B, B' and B''."""
        arm, omega = self.arm, self._omega
        velocity = by_velocity + ca.cross(by_acceleration, omega)
        position = by_position + ca.cross(velocity, omega) + ca.cross(by_acceleration, self._epsilon)
        spun = ca.cross(ca.cross(omega, arm), by_acceleration)
        return Slopes(
            ca.horzcat(by_position.T, ca.cross(arm, position).T),
            ca.horzcat(by_velocity.T, (ca.cross(arm, velocity) + spun).T),
            self.wrench(by_acceleration).T,
        )

    def wrench(self, force: ca.SX) -> ca.SX:
        """Returns force and moment about O1 (6,) of a force at the joint."""
        return ca.vertcat(force, ca.cross(self.arm, force))

    def own(self, slopes: LegSlopes) -> Slopes:
        """Returns the rows (1, 6) of what the leg takes along its own line."""
        return self.row(*(slopes.vectors @ inner[0, :].T for inner in slopes.inner))

    def spread(self, slopes: LegSlopes) -> Slopes:
        """Returns the slopes (6, 6) of what the leg takes otherwise, besides the parts with `equal`."""
        s, velocity = slopes.vectors[:, 0], slopes.vectors[:, 1]
        by_S, by_dS, _ = slopes.inner
        none = ca.SX(3, 1)
        across = slopes.vectors[:, 1:] @ by_S[1:, 0]
        along = self.row(by_S[1, 1] * velocity, by_dS[1, 0] * s, none)
        wrench = self.wrench(velocity)
        by_pose = wrench @ along.by_pose + self.wrench(across) @ self.wrench(s).T
        return Slopes(by_pose, wrench @ along.by_twist, ca.SX(6, 6))
