"""Joint coordinates of the hexapod as a tree: a free-flyer, and per leg a spherical and a prismatic joint.

Maps between the motion of the platform and (q, v, a) of all 30 degrees of freedom of the tree that is cut
open at the platform joints, in closed form and without any robotics library. Coordinates are Pinocchio's:

    q (37,)  platform: position less home, quaternion x, y, z, w; then per leg: quaternion x, y, z, w of
             the turn from its home direction, and length less length at home
    v (30,)  platform: velocity of O1 and angular velocity, platform axes; then per leg: angular
             velocity, leg axes, and length rate
    a (30,)  the same one derivative on; that of the free-flyer is spatial, R^T p'' - omega x v
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from sixsps.arrays import Array, frozen
from sixsps.errors import MotionError
from sixsps.mechanism import Mechanism
from sixsps.pose import Pose
from sixsps.rotation import cross
from sixsps.singularity import SINGULAR_CONDITION
from urdf.closure_rates import GAP, Ends
from urdf.layout import Layout
from urdf.platform_state import PlatformState

NQ, NV = 37, 30


@dataclass(frozen=True, eq=False)
class LegGeometry:
    """The legs at one pose of the platform, world axes.

    Attributes:
        arms: (6, 3) c_i, O1 to platform joint [m].
        directions: (6, 3) unit vectors s_i, base joint to platform joint.
        lengths: (6,) [m].
    """

    arms: Array
    directions: Array
    lengths: Array

    @property
    def jacobian(self) -> Array:
        """(6, 6) with length_rates = jacobian @ [velocity; angular_velocity]."""
        return np.hstack([self.directions, cross(self.arms, self.directions)])

    def rates(self, velocity: Array, omega: Array) -> tuple[Array, Array]:
        """Returns length rates (6,) and angular velocities (6, 3) of legs that do not spin."""
        tip = velocity + cross(omega, self.arms)
        rates = np.einsum("ki,ki->k", self.directions, tip)
        return rates, cross(self.directions, tip) / self.lengths[:, None]

    def accelerations(
        self, twist: tuple[Array, Array], acceleration: tuple[Array, Array], spins: Array
    ) -> tuple[Array, Array]:
        """Returns length accelerations (6,) and angular accelerations (6, 3) of legs of constant spin.

        Args:
            twist: of the platform, linear and angular.
            acceleration: of the platform, linear and angular.
            spins: (6,) angular velocities of the legs about their own axes [rad/s].
        """
        s, l = self.directions, self.lengths[:, None]  # noqa: E741
        (velocity, omega), (linear, epsilon) = twist, acceleration
        turning = cross(omega, self.arms)
        tip = linear + cross(epsilon, self.arms) + cross(omega, turning)
        rates, across = self.rates(velocity, omega)
        accelerations = np.einsum("ki,ki->k", s, tip) + self.lengths * np.einsum("ki,ki->k", across, across)
        angular = (cross(s, tip) - 2 * rates[:, None] * across) / l
        return accelerations, angular + spins[:, None] * cross(across, s)


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Maps between the platform's motion and the tree's coordinates, one sample at a time.

    No pose locks a joint: a ball is a quaternion. A leg's own turn about its axis moves nothing; it is none
    in `configuration` and `velocity`, and whatever q and v hold elsewhere.

    Attributes:
        mechanism: its anchors, and its home pose.
    """

    mechanism: Mechanism

    @cached_property
    def layout(self) -> Layout:
        """The home pose."""
        return Layout.of(self.mechanism)

    @cached_property
    def leg_frames(self) -> Array:
        """(6, 3, 3) axes of the legs at home, in columns: z along the leg, no roll."""
        turns = [(leg.yaw, leg.pitch) for leg in self.layout.legs]
        return np.asarray(Rotation.from_euler("ZY", turns).as_matrix())

    @property
    def home(self) -> Array:
        """(37,) q of the home pose."""
        q = np.zeros(NQ)
        q[6] = q[10::5] = 1.0
        return q

    def configuration(self, position: ArrayLike, orientation: ArrayLike) -> Array:
        """Returns q (37,) that puts the platform there, each leg turned the shortest way from home.

        Args:
            position: (3,) platform origin O1, world frame [m].
            orientation: (4,) quaternion w, x, y, z, or (3, 3) rotation matrix, platform axes to world axes.

        Raises:
            MotionError: not a pose, or a leg would have no length.
        """
        pose = Pose.of((position, orientation))
        legs = self._legs(pose.position, pose.rotation)
        q = np.empty(NQ)
        q[:3], q[3:7] = pose.position - self.layout.home, np.roll(pose.quaternion, -1)
        turned = q[7:].reshape(6, 5)
        turned[:, :4] = _shortest_turns(np.einsum("kji,kj->ki", self.leg_frames, legs.directions))
        turned[:, 4] = legs.lengths - [leg.length for leg in self.layout.legs]
        return q

    def velocity(self, q: ArrayLike, twist: ArrayLike) -> Array:
        """Returns v (30,) of the platform's twist, legs without spin.

        Args:
            q: (37,) with closed loops.
            twist: (6,) velocity of O1 [m/s] and angular velocity [rad/s], world axes.

        Raises:
            MotionError: a shape differs, an entry is not finite, or the loops of q are open.
        """
        linear, omega = np.split(frozen(twist, (6,), "twist", MotionError), 2)
        rotation, legs, axes = self._closed(q)
        v = np.empty(NV)
        v[:3], v[3:6] = linear @ rotation, omega @ rotation
        rates, turning = legs.rates(linear, omega)
        v[6:] = np.column_stack([np.einsum("kji,kj->ki", axes, turning), rates]).ravel()
        return v

    def acceleration(self, q: ArrayLike, v: ArrayLike, acceleration: ArrayLike) -> Array:
        """Returns a (30,) of the platform's acceleration; spins of the legs in v stay as they are.

        Args:
            q: (37,) with closed loops.
            v: (30,) that keeps them closed.
            acceleration: (6,) acceleration of O1 [m/s^2] and angular acceleration [rad/s^2], world axes.

        Raises:
            MotionError: a shape differs, an entry is not finite, the loops of q are open, or v opens them.
        """
        linear, epsilon = np.split(frozen(acceleration, (6,), "acceleration", MotionError), 2)
        v = frozen(v, (NV,), "v", MotionError)
        rotation, legs, axes = self._closed(q)
        Ends(rotation, legs.arms, axes, legs.lengths).velocities(v).check("v", "m/s", "velocity")
        a = np.empty(NV)
        a[:3], a[3:6] = linear @ rotation - np.cross(v[3:6], v[:3]), epsilon @ rotation
        twist = rotation @ v[:3], rotation @ v[3:6]
        rates, turning = legs.accelerations(twist, (linear, epsilon), v[8::4])
        a[6:] = np.column_stack([np.einsum("kji,kj->ki", axes, turning), rates]).ravel()
        return a

    def check_closed(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> None:
        """Refuses what is no motion of the closed chain, up to 1e-6 of what moves.

        Args:
            q: (37,).
            v: (30,).
            a: (30,).

        Raises:
            MotionError: a shape differs, an entry is not finite, the loops of q are open, v opens them
                (Jc v is not 0), or a does at this v (Jc a + Jc' v is not 0).
        """
        v, a = frozen(v, (NV,), "v", MotionError), frozen(a, (NV,), "a", MotionError)
        self._closed_legs(q, v, a)

    def platform_state(
        self, q: ArrayLike, v: ArrayLike | None = None, a: ArrayLike | None = None
    ) -> PlatformState:
        """Returns what q, v and a say of the platform; zeros stand for what is not given.

        Args:
            q: (37,); what it says of the legs is not looked at.
            v: (30,).
            a: (30,).

        Raises:
            MotionError: a shape differs, an entry is not finite, or a quaternion is not of unit length.
        """
        pose = self._pose(self._checked(q))
        v = np.zeros(NV) if v is None else frozen(v, (NV,), "v", MotionError)
        a = np.zeros(NV) if a is None else frozen(a, (NV,), "a", MotionError)
        R = pose.rotation
        classical = a[:3] + np.cross(v[3:6], v[:3])
        return PlatformState(
            pose.position, pose.quaternion, R @ v[:3], R @ v[3:6], R @ classical, R @ a[3:6]
        )  # fmt: skip

    def legs(self, q: ArrayLike) -> LegGeometry:
        """Returns the legs as they stand between base and platform, whatever q says of their joints.

        Args:
            q: (37,).

        Raises:
            MotionError: the shape differs, an entry is not finite, a quaternion is not of unit length, or
                a leg has no length.
        """
        pose = self._pose(self._checked(q))
        return self._legs(pose.position, pose.rotation)

    def _closed_legs(self, q: ArrayLike, v: Array, a: Array) -> LegGeometry:
        """Returns the legs of a motion of the closed chain, see `check_closed`."""
        rotation, legs, axes = self._closed(q)
        ends = Ends(rotation, legs.arms, axes, legs.lengths)
        ends.velocities(v).check("v", "m/s", "velocity")
        ends.accelerations(v, a).check("a", "m/s^2", "acceleration")
        return legs

    @staticmethod
    def _checked(q: ArrayLike) -> Array:
        q = frozen(q, (NQ,), "q", MotionError)
        lengths = np.linalg.norm([q[3:7], *q[7:].reshape(6, 5)[:, :4]], axis=1)
        worst = int(np.argmax(np.abs(lengths - 1)))
        if abs(lengths[worst] - 1) > GAP:
            whose = f"leg {worst}" if worst else "the platform"
            found = f"a quaternion of length {lengths[worst]:.9g}, of {whose}"
            raise MotionError("q", found, "unit length, as pinocchio.normalize makes it")
        return q

    def _pose(self, q: Array) -> Pose:
        return Pose.of((self.layout.home + q[:3], np.roll(q[3:7], 1)))

    def _legs(self, position: Array, rotation: Array) -> LegGeometry:
        arms = self.mechanism.platform_anchors @ rotation.T
        # In this order a world frame far away costs no digits of the arms.
        vectors = (position - self.mechanism.base_anchors) + arms
        lengths = np.linalg.norm(vectors, axis=1)
        shortest, leg = self.mechanism.characteristic_length / SINGULAR_CONDITION, int(np.argmin(lengths))
        if lengths[leg] <= shortest:
            found = f"leg {leg + 1} of length {lengths[leg]:.3g} m"
            raise MotionError("pose", found, f"legs longer than {shortest:.3g} m, which have a direction")
        return LegGeometry(arms, vectors / lengths[:, None], lengths)

    def _closed(self, q: ArrayLike) -> tuple[Array, LegGeometry, Array]:
        """Returns rotation of the platform, legs, and (6, 3, 3) axes of the legs, of closed loops."""
        q = self._checked(q)
        pose = self._pose(q)
        legs = self._legs(pose.position, pose.rotation)
        turned = q[7:].reshape(6, 5)
        axes = self.leg_frames @ Rotation.from_quat(turned[:, :4]).as_matrix()
        lengths = turned[:, 4] + [leg.length for leg in self.layout.legs]
        tips = lengths[:, None] * axes[:, :, 2]
        gaps = np.linalg.norm(tips - legs.lengths[:, None] * legs.directions, axis=1)
        leg = int(np.argmax(gaps / legs.lengths))
        if not gaps[leg] <= GAP * legs.lengths[leg]:
            allowed = f"loops closed to {GAP:g} of the leg, as those of `configuration`"
            raise MotionError("q", f"the loop of leg {leg + 1} is open by {gaps[leg]:.3g} m", allowed)
        return pose.rotation, legs, axes


def _shortest_turns(directions: Array) -> Array:
    """Returns (n, 4) quaternions x, y, z, w of the shortest turns of the z axis to unit vectors (n, 3)."""
    x, y, z = directions.T
    # By the half angle, which keeps all digits near half a turn; along z any axis will do.
    across = np.hypot(x, y)
    half, straight = np.arctan2(across, z) / 2, across == 0
    divisor = np.where(straight, 1.0, across)
    about_x, about_y = np.where(straight, 1.0, -y / divisor), x / divisor
    sine = np.sin(half)
    return np.column_stack([sine * about_x, sine * about_y, np.zeros_like(x), np.cos(half)])
