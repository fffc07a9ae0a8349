"""Exact derivatives of the leg lengths with respect to what a calibration looks for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sixsps.arrays import Array
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion


@dataclass(frozen=True, eq=False)
class LengthDerivatives:
    """Leg lengths at n samples and their exact derivatives.

    A leg's length depends on its own two anchors only: the entries of leg i are those of A_i and b_i.

    Attributes:
        lengths: (n, 6) [m].
        by_base_anchors: (n, 6, 3) with respect to A_i, world frame: -s_i.
        by_platform_anchors: (n, 6, 3) with respect to b_i, platform frame: R^T s_i.
        by_pose: (n, 6, 6) with respect to [dp; dtheta], the pose perturbed to (P + dp, exp([dtheta]x) R),
            world axes: the Jacobian [1, m].
    """

    lengths: Array
    by_base_anchors: Array
    by_platform_anchors: Array
    by_pose: Array

    @property
    def pose_by_anchors(self) -> Array:
        """(n, 6, 36) derivatives of the pose [dp; dtheta] at given lengths, by A_1..A_6, then b_1..b_6.

        Where errors of the anchors take the platform: by the implicit function theorem -J^-1 dl. A
        singular pose has none and raises `numpy.linalg.LinAlgError`, or what rounding makes of it.
        """
        n = len(self.lengths)
        blocks = np.zeros((n, 6, 2, 6, 3))
        legs = np.arange(6)
        blocks[:, legs, 0, legs] = self.by_base_anchors
        blocks[:, legs, 1, legs] = self.by_platform_anchors
        return np.asarray(-np.linalg.solve(self.by_pose, blocks.reshape(n, 6, 36)))


def length_derivatives(mechanism: Mechanism, motion: Motion) -> LengthDerivatives:
    """Returns leg lengths and their exact derivatives by anchors and pose.

    Derivatives of the leg forces by anchors and all other parameters are
    `sixsps.compile(mechanism).parameter_derivatives`.

    Args:
        mechanism: geometry; it may be geometry alone.
        motion: n samples, of which the poses count.
    """
    legs = inverse_kinematics(mechanism, motion)
    s = legs.directions
    return LengthDerivatives(
        lengths=legs.lengths,
        by_base_anchors=-s,
        by_platform_anchors=np.einsum("nji,nkj->nki", motion.rotation, s),
        by_pose=legs.jacobian,
    )
