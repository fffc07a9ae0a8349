"""A trap in MuJoCo: mj_inverse with the soft loop closures left on."""

from __future__ import annotations

import mujoco
import numpy as np

from compare.engines.mujoco import Mujoco
from sixsps.arrays import Array
from sixsps.mechanism import Mechanism


class MujocoEquality(Mujoco):
    """mj_inverse as the file is loaded, its `<connect>` closures on, and the actuators' joints read."""

    formulation = "mj_inverse with the closures left on"
    loops = "soft <connect>; qfrc_inverse at the actuator joints taken for the leg forces"
    shares = "joint positions and rates with mujoco"

    def __init__(self, mechanism: Mechanism) -> None:
        super().__init__(mechanism)
        self.tree.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)

    def close_loops(self, tau: Array) -> Array:
        """Returns tau at the actuators, and as residual the largest that it leaves elsewhere."""
        actuated = self.tree.actuated
        return np.array([*tau[actuated], np.abs(np.delete(tau, actuated)).max()])
