"""The hexapod for users of Pinocchio: model, data, closures, and what actuators must do.

Pinocchio is imported in the functions that need it, so that the names are there without it.

The maps between platform and (q, v, a) are closed forms of the legs' geometry, not of Pinocchio's
Jacobians: that they obey the closures, Jc v = 0 and Jc a + Jc' v = 0, checks both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.lapack import dgels

from sixsps.arrays import Array, frozen
from sixsps.errors import EngineError, MotionError
from sixsps.mechanism import Mechanism
from sixsps.singularity import SINGULAR_CONDITION, condition_numbers
from urdf.closures import CLOSURES
from urdf.coordinates import NV, Coordinates, LegGeometry
from urdf.libraries import check_installed, import_user


@dataclass(frozen=True, eq=False)
class ActuatorForces:
    """What moves or holds the closed chain.

    Attributes:
        forces: (6,) leg forces [N], positive in extension; NaN at a singular pose.
        closure_forces: (6, 3) forces of the platform joints on the legs' tips, world axes [N]; the platform
            receives the opposite. NaN at a singular pose.
        residual: the largest generalised force that neither actuators nor closures supply [N, N m]:
            rounding, where q, v and a are of a hexapod whose legs turn freely about their axes.
    """

    forces: Array
    closure_forces: Array
    residual: float


@dataclass(frozen=True, eq=False)
class PinocchioHexapod(Coordinates):
    """A hexapod in Pinocchio, see `urdf.coordinates` for q, v and a.

    `data` and `constraint_datas` are work space that `actuator_forces` overwrites: one object a thread. What
    copy and pickle give back is built anew from the mechanism, without what was added to the model.

    Attributes:
        model: the open tree, `pinocchio.Model`, see `urdf.pinocchio_model`; gravity is the mechanism's, and
            `referenceConfigurations["home"]` its home pose.
        data: its data, ready for `constraintDynamics`.
        constraint_models: the six closures as `RigidConstraintModel`, leg tip first, then platform anchor.
        constraint_datas: their data.
        actuators: names of the actuated joints.
        actuator_q: (6,) their indices in q.
        actuator_v: (6,) their indices in v, a and tau.
    """

    model: Any
    data: Any
    constraint_models: Any
    constraint_datas: Any
    actuators: tuple[str, ...]
    actuator_q: NDArray[np.intp]
    actuator_v: NDArray[np.intp]

    def __reduce__(self) -> tuple[Any, tuple[Mechanism]]:
        # Pinocchio's vectors of constraints refuse to be pickled.
        return load_pinocchio, (self.mechanism,)

    def external_forces(self, q: ArrayLike, force: ArrayLike, moment: ArrayLike = (0, 0, 0)) -> Any:
        """Returns what `pinocchio.rnea` takes as external forces, for a wrench on the platform.

        Args:
            q: (37,).
            force: (3,) on the platform's centre of mass, world axes [N].
            moment: (3,) world axes [N m].

        Returns:
            `StdVec_Force`, one for each joint, in the axes of its frame and about its origin.

        Raises:
            MotionError: a shape differs, or an entry is not finite.
        """
        import pinocchio as pin

        R = self.platform_state(q).rotation
        f = frozen(force, (3,), "force", MotionError) @ R
        m = frozen(moment, (3,), "moment", MotionError) @ R
        wrenches = [pin.Force.Zero() for _ in range(self.model.njoints)]
        wrenches[self.model.getJointId("platform_joint")] = pin.Force(
            f, m + np.cross(self.mechanism.platform.com, f)
        )
        return pin.StdVec_Force(wrenches)

    def actuator_forces(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, external: Any = None
    ) -> ActuatorForces:
        """Returns the leg forces that a motion of the closed chain takes, and the forces in its closures.

        RNEA gives the generalised forces tau that the open tree would take; six actuators and 18 closure
        forces have to supply them: [S, Jc^T] [F; lambda] = tau, 30 equations of rank 24, by least squares.

        Args:
            q: (37,) with closed loops, as of `configuration`.
            v: (30,) that keeps them closed, as of `velocity`; zeros at rest.
            a: (30,) that keeps them closed at v, as of `acceleration`; zeros at rest.
            external: as `pinocchio.rnea` takes it, see `external_forces`; none by default.

        Raises:
            MotionError: a shape differs, an entry is not finite, or q, v and a do not keep the loops closed,
                see `check_closed`.
            EngineError: the solve failed.
        """
        import pinocchio as pin

        q, v, a = self._checked(q), frozen(v, (NV,), "v", MotionError), frozen(a, (NV,), "a", MotionError)
        condition = self._condition(self._closed_legs(q, v, a))
        model, data = self.model, self.data
        tau = pin.rnea(model, data, q, v, a, *([] if external is None else [external]))
        matrix = np.zeros((NV, 24))
        matrix[self.actuator_v, np.arange(6)] = 1.0
        matrix[:, 6:] = self.closure_jacobian(q).T
        if condition > SINGULAR_CONDITION:
            return ActuatorForces(np.full(6, np.nan), np.full((6, 3), np.nan), np.nan)
        # Moments over a length of the mechanism: its unit must not decide what rounding does.
        _, solution, info = dgels(matrix / self._units[:, None], tau / self._units)
        if info != 0:
            raise EngineError(f"the loop-closing solve failed: dgels returned {info}")
        forces, multipliers = solution[:6], solution[6:24].reshape(6, 3)
        residual = float(np.abs(tau - matrix @ solution[:24]).max())
        tips = [data.oMi[model.getJointId(name)].rotation for name in self.actuators]
        return ActuatorForces(forces, np.einsum("kij,kj->ki", tips, multipliers), residual)

    def closure_jacobian(self, q: ArrayLike) -> Array:
        """Returns Jc (18, 30): the velocity of each tip less that of its anchor, in the tip's axes, is Jc v.

        Args:
            q: (37,).

        Raises:
            MotionError: the shape differs, an entry is not finite, or a quaternion is not of unit length.
        """
        import pinocchio as pin

        model, data = self.model, self.data
        pin.computeJointJacobians(model, data, self._checked(q))
        for closure, closure_data in zip(self.constraint_models, self.constraint_datas, strict=True):
            closure.calc(model, data, closure_data)  # without it the Jacobian is silently wrong
        jacobian = pin.getConstraintsJacobian(model, data, self.constraint_models, self.constraint_datas)
        return np.asarray(jacobian)

    def _condition(self, legs: LegGeometry) -> float:
        length = self.mechanism.characteristic_length
        return float(condition_numbers(legs.jacobian[None], legs.lengths[None], length)[0])

    @property
    def _units(self) -> Array:
        units = np.ones(NV)
        units[3:6] = self.mechanism.characteristic_length
        units[6:].reshape(6, 4)[:, :3] = self.mechanism.characteristic_length
        return units


def load_pinocchio(mechanism: Mechanism) -> PinocchioHexapod:
    """Returns the mechanism as Pinocchio model, data and loop closures, with maps from and to the platform.

    Args:
        mechanism: geometry and inertia.

    Raises:
        EngineUnavailable: Pinocchio is missing or broken.
        MechanismError: the mechanism is geometry alone.
    """
    check_installed("pinocchio", "pinocchio", "pin")
    import_user("urdf.pinocchio_model", "pinocchio", "pinocchio", "pin")
    import pinocchio as pin

    from urdf.pinocchio_model import build_closures, build_model

    model = build_model(mechanism)
    closures = build_closures(model)
    closure_datas = pin.StdVec_RigidConstraintData()
    for closure in closures:
        closure_datas.append(closure.createData())
    data = model.createData()
    pin.initConstraintDynamics(model, data, closures, closure_datas)
    joints = [model.joints[model.getJointId(name)] for name in CLOSURES.name_mot]
    return PinocchioHexapod(
        mechanism=mechanism,
        model=model,
        data=data,
        constraint_models=closures,
        constraint_datas=closure_datas,
        actuators=CLOSURES.name_mot,
        actuator_q=np.array([joint.idx_q for joint in joints]),
        actuator_v=np.array([joint.idx_v for joint in joints]),
    )
