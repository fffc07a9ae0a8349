"""Traps in Pinocchio: the open tree's torques read as leg forces, and solvers made for contacts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from compare.engines.pinocchio import Pinocchio
from sixsps.arrays import Array
from sixsps.mechanism import Mechanism
from urdf.closures import CLOSURES

_NOT_CLOSED = (np.nan, np.nan)


class PinocchioTree(Pinocchio):
    """RNEA of the open tree, its actuator entries taken for leg forces."""

    loops = "not at all"
    shares = "everything with pinocchio but the solve that closes the loops"

    def sample(self, q: Array, v: Array, a: Array, external: Any) -> Array:
        """Returns the open tree's actuator forces; see `Pinocchio.sample`."""
        tau = pin.rnea(self.tree.model, self.tree.data, q, v, a, external)
        return np.array([*tau[self.tree.actuated], *_NOT_CLOSED])


class PinocchioContact(Pinocchio):
    """`contactInverseDynamics` with the loop closures as contacts.

    It has no argument for external wrenches, and like other functions of the library it leaves it
    to the caller to `calc` every constraint. Without that it reports convergence all the same; with
    it, on a motion that keeps the loops closed, it diverges.
    """

    formulation = "contactInverseDynamics"
    loops = "point contacts with friction at the platform joints"
    shares = "joint positions and rates with pinocchio"
    _time_step = 1e-3

    def __init__(self, mechanism: Mechanism) -> None:
        super().__init__(mechanism)
        model = self.tree.model
        self.contacts = pin.StdVec_PointContactConstraintModel()
        self.contact_data = pin.StdVec_PointContactConstraintData()
        for pair in CLOSURES.closed_loop:
            frames = [model.frames[model.getFrameId(name)] for name in pair]
            ends = [end for frame in frames for end in (frame.parentJoint, frame.placement)]
            self.contacts.append(pin.PointContactConstraintModel(model, *ends))
            self.contact_data.append(self.contacts[-1].createData())

    def sample(self, q: Array, v: Array, a: Array, external: Any) -> Array:  # noqa: ARG002
        """Returns what the contact solver says of the actuators; see `Pinocchio.sample`."""
        _, tau, _ = pin.contactInverseDynamics(
            self.tree.model, self.tree.data, q, v, a, self._time_step, self.contacts, self.contact_data,
            np.zeros(3 * len(self.contacts)), pin.ProximalSettings(1e-12, 1e-10, 100),
        )  # fmt: skip
        return np.array([*np.asarray(tau)[self.tree.actuated], *_NOT_CLOSED])
