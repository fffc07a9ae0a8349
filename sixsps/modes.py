"""Small vibrations of the platform on elastic actuators: frequencies, mode shapes, compliance.

About a pose at rest, with leg forces F = F0 - k (l - l0), the platform moves by
M q'' + (J k J^T + K_g) q = 0, where q = [dp; dtheta] displaces O1 and turns the platform, world axes.
F0 are the forces that hold the pose against gravity and the external wrench. K_g, the geometric
stiffness, is what turning these constant forces and moving the weights does: the second derivative of

    Pi = - sum F0_i l_i - weights . positions - force . (position of the platform's com)

along p + dp, exp([dtheta]x) R. It is symmetric. An external moment enters F0 only; it is then one that
keeps energy (semitangential: it follows half of a turn), for one that is fixed in the world does not
and has no modes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from sixsps.arrays import Array, frozen
from sixsps.dynamics import mass_matrix
from sixsps.errors import InputError
from sixsps.formulations import inverse_dynamics
from sixsps.kinematics import LegKinematics, inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.rotation import skew
from sixsps.singularity import SINGULAR_CONDITION

_LARGEST_TURN_ERROR = 1e-6


@dataclass(frozen=True, eq=False)
class Modes:
    """Linearised motion of the platform about a pose, [displacement of O1; rotation], world axes.

    Attributes:
        rotation: (3, 3) platform axes to world axes at the pose.
        mass_matrix: (6, 6) platform and legs, about O1.
        stiffness_matrix: (6, 6) wrench about O1 against [displacement; rotation], symmetric.
        geometric_stiffness: (6, 6) the part of it that gravity and the external force cause.
        leg_forces: (6,) that hold the pose [N], positive in extension.
        characteristic_length: length that makes rotations comparable to displacements [m].
    """

    rotation: Array
    mass_matrix: Array
    stiffness_matrix: Array
    geometric_stiffness: Array
    leg_forces: Array
    characteristic_length: float

    @cached_property
    def _solution(self) -> tuple[Array, Array]:
        from scipy.linalg import eigh

        scale = np.repeat([1.0, 1 / self.characteristic_length], 3)
        units = np.outer(scale, scale)
        squares, shapes = eigh(units * self.stiffness_matrix, units * self.mass_matrix)
        return squares, scale[:, None] * shapes

    @property
    def frequencies(self) -> Array:
        """(6,) natural frequencies in ascending order [Hz].

        Negative where the preload is more than the actuators can stabilise: -f is then a motion that
        grows by exp(2 pi f t).
        """
        squares = self._solution[0]
        return np.asarray(np.sign(squares) * np.sqrt(np.abs(squares)) / (2 * np.pi))

    @property
    def shapes(self) -> Array:
        """(6, 6) mode shapes in columns, with shapes^T mass_matrix shapes = 1."""
        return self._solution[1]

    @property
    def proportions(self) -> Array:
        """(6, 6) mode shapes in columns, rotations times the characteristic length, largest entry 1."""
        shapes = self.shapes * np.repeat([1.0, self.characteristic_length], 3)[:, None]
        largest = np.abs(shapes).argmax(axis=0)
        return shapes / shapes[largest, np.arange(6)]

    def compliance(self, point: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
        """Returns what a small wrench at a point of the platform does there, actuators being held.

        Args:
            point: (3,) platform frame [m].

        Returns:
            (6, 6) [displacement of the point; rotation] for [force; moment about the point], world
            axes [m/N], [rad/N], [m/(N m)], [rad/(N m)]; symmetric.

        Raises:
            InputError: `point` is not three finite numbers.
        """
        r = self.rotation @ frozen(point, (3,), "point", InputError)
        transfer = np.eye(6)
        transfer[:3, 3:] = -skew(r)
        scale = np.repeat([1.0, 1 / self.characteristic_length], 3)
        units = np.outer(scale, scale)
        flexibility = units * np.linalg.inv(units * self.stiffness_matrix)
        matrix = transfer @ flexibility @ transfer.T
        return np.asarray((matrix + matrix.T) / 2)


def modes(
    mechanism: Mechanism,
    position: ArrayLike,
    rotation: ArrayLike,
    stiffness: ArrayLike,
    *,
    force: ArrayLike = (0.0, 0.0, 0.0),
    moment: ArrayLike = (0.0, 0.0, 0.0),
    preload: bool = True,
) -> Modes:
    """Returns the small vibrations about a pose at rest.

    Args:
        mechanism: geometry and inertia.
        position: (3,) of O1 [m].
        rotation: (3, 3) platform axes to world axes.
        stiffness: of the actuators along their legs [N/m], one for all or (6,).
        force: (3,) constant external force on the platform's centre of mass, world axes [N].
        moment: (3,) external moment on the platform, world axes [N m].
        preload: whether geometric stiffness counts.

    Raises:
        InputError: a stiffness is not positive, a value is not finite, `rotation` is no rotation, or
            the pose is singular.
    """
    k = _stiffnesses(stiffness)
    at_rest = _at_rest(position, rotation, force, moment)
    legs = inverse_kinematics(mechanism, at_rest)
    condition = float(legs.condition[0])
    if not condition <= SINGULAR_CONDITION:
        raise InputError("pose", f"cond(J) = {condition:.3g}", "a pose that is not singular")
    leg_forces = inverse_dynamics(mechanism, at_rest)[0]
    geometric = np.zeros((6, 6))
    if preload:
        geometric = _geometric_stiffness(mechanism, at_rest, legs, leg_forces)
    jacobian = legs.jacobian[0]
    return Modes(
        rotation=at_rest.rotation[0],
        mass_matrix=mass_matrix(mechanism, at_rest.position, at_rest.rotation)[0],
        stiffness_matrix=jacobian.T @ (k[:, None] * jacobian) + geometric,
        geometric_stiffness=geometric,
        leg_forces=leg_forces,
        characteristic_length=mechanism.characteristic_length,
    )


def _stiffnesses(given: ArrayLike) -> Array:
    shape = () if np.ndim(given) == 0 else (6,)
    k = np.broadcast_to(frozen(given, shape, "stiffness", InputError), 6)
    if k.min() <= 0:
        raise InputError("stiffness", float(k.min()), "> 0 [N/m]")
    return k


def _at_rest(position: ArrayLike, rotation: ArrayLike, force: ArrayLike, moment: ArrayLike) -> Motion:
    from scipy.spatial.transform import Rotation

    R = frozen(rotation, (3, 3), "rotation", InputError)
    if np.abs(R @ R.T - np.eye(3)).max() > _LARGEST_TURN_ERROR or np.linalg.det(R) < 0:
        raise InputError("rotation", R.tolist(), "a rotation matrix")
    still = np.zeros((1, 3))
    return Motion(
        time=np.zeros(1),
        position=frozen(position, (3,), "position", InputError)[None],
        quaternion=Rotation.from_matrix(R[None]).as_quat(scalar_first=True),
        velocity=still,
        angular_velocity=still,
        acceleration=still,
        angular_acceleration=still,
        force=frozen(force, (3,), "force", InputError)[None],
        moment=frozen(moment, (3,), "moment", InputError)[None],
    )


def _geometric_stiffness(mechanism: Mechanism, motion: Motion, legs: LegKinematics, forces: Array) -> Array:
    """Returns the second derivative of Pi, a sum of functions of joint centres B_i and of the com."""
    lower, upper, platform, g = mechanism.lower, mechanism.upper, mechanism.platform, mechanism.gravity
    matrix = np.zeros((6, 6))
    for i in range(6):
        s, l, c = legs.directions[0, i], legs.lengths[0, i], legs.arms[0, i]  # noqa: E741
        across = np.eye(3) - np.outer(s, s)
        # Weights ride on the leg: m_d at A + e_d s, m_u at B - e_u s.
        lever = lower.mass[i] * lower.com[i] - upper.mass[i] * upper.com[i]
        gradient = -forces[i] * s - lever * across @ g / l - upper.mass[i] * g
        tilting = np.outer(across @ g, s)
        hessian = -forces[i] * across / l + lever * (tilting + tilting.T + (s @ g) * across) / l**2
        matrix += _on_platform(c, gradient, hessian)
    load = -platform.mass * g - motion.force[0]
    return matrix + _on_platform(motion.rotation[0] @ platform.com, load, np.zeros((3, 3)))


def _on_platform(arm: Array, gradient: Array, hessian: Array) -> Array:
    """Returns the second derivative by [dp; dtheta] of a function of a point of the platform.

    The point moves by dp + dtheta x c + dtheta x (dtheta x c) / 2.

    Args:
        arm: (3,) c, from O1 to the point [m].
        gradient: (3,) of the function by the point.
        hessian: (3, 3) of the function by the point.
    """
    first = np.hstack([np.eye(3), -skew(arm)])
    matrix = first.T @ hessian @ first
    turning = np.outer(gradient, arm)
    matrix[3:, 3:] += (turning + turning.T) / 2 - (gradient @ arm) * np.eye(3)
    return np.asarray(matrix)
