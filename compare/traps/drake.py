"""Drake's inverse dynamics taken at its word: the constraints are in the plant, so one call should do."""

from __future__ import annotations

import numpy as np

from compare.engine import EngineForces, Progress
from compare.engines.drake import Drake, tree_forces
from sixsps.motion import Motion


class DrakeTree(Drake):
    """The plant with its six ball constraints; of CalcInverseDynamics the entries of the actuators."""

    formulation = "recursive Newton-Euler (CalcInverseDynamics)"
    loops = "six ball constraints in the plant, which CalcInverseDynamics ignores"
    shares = "everything with drake but the loop-closing solve"
    closed = True

    def inverse_dynamics(self, motion: Motion, progress: Progress) -> EngineForces:
        """Returns wrong leg forces along a motion."""
        actuated = self._tree.actuated
        forces = np.array([tau[actuated] for tau, _ in tree_forces(self._tree, motion)])
        progress(len(motion))
        return EngineForces(forces.reshape(-1, 6))
