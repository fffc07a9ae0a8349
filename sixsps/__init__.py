"""Leg forces of a hexapod (6-SPS, Stewart-Gough platform).

Conventions, once for all: SI units. World frame O-XYZ on the base, platform frame O1-X1Y1Z1 on the
platform. Arrays are float64, time first: (n, 3), (n, 6). Twist and wrench have the linear part
first. Angular velocity and acceleration are world-frame vectors. Quaternions are w, x, y, z; Euler
angles are R = Rx(alpha) Ry(beta) Rz(gamma), at the edges only. A leg force is positive when the
actuator pushes, which extends the leg. Legs carry no spin about their own axis.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sixsps.assembly import AssemblyMode as AssemblyMode
    from sixsps.assembly import AssemblyModes as AssemblyModes
    from sixsps.assembly import SingularMode as SingularMode
    from sixsps.assembly import assembly_modes as assembly_modes
    from sixsps.bodies import Leg as Leg
    from sixsps.bodies import Link as Link
    from sixsps.bodies import Platform as Platform
    from sixsps.calibration import LengthDerivatives as LengthDerivatives
    from sixsps.calibration import length_derivatives as length_derivatives
    from sixsps.dynamics import State as State
    from sixsps.dynamics import bias as bias
    from sixsps.dynamics import forward_dynamics as forward_dynamics
    from sixsps.dynamics import kinetic_energy as kinetic_energy
    from sixsps.dynamics import mass_matrix as mass_matrix
    from sixsps.dynamics import potential_energy as potential_energy
    from sixsps.errors import ConvergenceError as ConvergenceError
    from sixsps.errors import EngineError as EngineError
    from sixsps.errors import EngineUnavailable as EngineUnavailable
    from sixsps.errors import InputError as InputError
    from sixsps.errors import MechanismError as MechanismError
    from sixsps.errors import MotionError as MotionError
    from sixsps.errors import OutputError as OutputError
    from sixsps.errors import SixspsError as SixspsError
    from sixsps.errors import UnknownNameError as UnknownNameError
    from sixsps.formulations import inverse_dynamics as inverse_dynamics
    from sixsps.formulations.newton_euler import joint_reactions as joint_reactions
    from sixsps.identification import base_parameters as base_parameters
    from sixsps.identification import identify as identify
    from sixsps.kernels.model import CompiledMechanism as CompiledMechanism
    from sixsps.kernels.model import compile as compile  # noqa: A004
    from sixsps.kinematics import LegKinematics as LegKinematics
    from sixsps.kinematics import inverse_kinematics as inverse_kinematics
    from sixsps.limits import Limits as Limits
    from sixsps.margins import limit_margins as limit_margins
    from sixsps.margins import pose_margins as pose_margins
    from sixsps.mechanism import Mechanism as Mechanism
    from sixsps.mechanism_file import bundled_mechanisms as bundled_mechanisms
    from sixsps.motion import Motion as Motion
    from sixsps.payload import Payload as Payload
    from sixsps.payload import attached as attached
    from sixsps.payload import shifted_wrench as shifted_wrench
    from sixsps.platform_pose import ForwardKinematics as ForwardKinematics
    from sixsps.platform_pose import forward_kinematics as forward_kinematics
    from sixsps.platform_rates import PlatformRates as PlatformRates
    from sixsps.platform_rates import forward_rates as forward_rates
    from sixsps.pose import Pose as Pose
    from sixsps.pose_quality import Quality as Quality
    from sixsps.pose_quality import quality as quality
    from sixsps.regressor import inertial_parameters as inertial_parameters
    from sixsps.regressor import wrench_forces as wrench_forces
    from sixsps.singular_poses.crossings import Crossings as Crossings
    from sixsps.singular_poses.crossings import singularity_crossings as singularity_crossings
    from sixsps.singular_poses.nearest import SingularityDistance as SingularityDistance
    from sixsps.singular_poses.nearest import singularity_distance as singularity_distance
    from sixsps.workspace import constant_orientation_workspace as constant_orientation_workspace
    from sixsps.workspace import orientation_workspace as orientation_workspace

# Imported when first asked for: the module alone has to be there at once.
_PLACES = {
    "AssemblyMode": "assembly",
    "AssemblyModes": "assembly",
    "CompiledMechanism": "kernels.model",
    "ConvergenceError": "errors",
    "Crossings": "singular_poses.crossings",
    "EngineError": "errors",
    "EngineUnavailable": "errors",
    "ForwardKinematics": "platform_pose",
    "InputError": "errors",
    "Leg": "bodies",
    "LegKinematics": "kinematics",
    "LengthDerivatives": "calibration",
    "Limits": "limits",
    "Link": "bodies",
    "Mechanism": "mechanism",
    "MechanismError": "errors",
    "Motion": "motion",
    "MotionError": "errors",
    "OutputError": "errors",
    "Payload": "payload",
    "Platform": "bodies",
    "PlatformRates": "platform_rates",
    "Pose": "pose",
    "Quality": "pose_quality",
    "SingularityDistance": "singular_poses.nearest",
    "SingularMode": "assembly",
    "SixspsError": "errors",
    "State": "dynamics",
    "UnknownNameError": "errors",
    "bias": "dynamics",
    "bundled_mechanisms": "mechanism_file",
    "attached": "payload",
    "assembly_modes": "assembly",
    "base_parameters": "identification",
    "compile": "kernels.model",
    "constant_orientation_workspace": "workspace",
    "forward_dynamics": "dynamics",
    "forward_kinematics": "platform_pose",
    "forward_rates": "platform_rates",
    "identify": "identification",
    "inertial_parameters": "regressor",
    "inverse_dynamics": "formulations",
    "inverse_kinematics": "kinematics",
    "joint_reactions": "formulations.newton_euler",
    "kinetic_energy": "dynamics",
    "length_derivatives": "calibration",
    "limit_margins": "margins",
    "mass_matrix": "dynamics",
    "pose_margins": "margins",
    "orientation_workspace": "workspace",
    "potential_energy": "dynamics",
    "quality": "pose_quality",
    "shifted_wrench": "payload",
    "singularity_crossings": "singular_poses.crossings",
    "singularity_distance": "singular_poses.nearest",
    "wrench_forces": "regressor",
}
_MODULES = ("margins", "rotation", "symbolic", "trajectories")

__all__ = sorted([*_PLACES, *_MODULES])


def __getattr__(name: str) -> Any:
    if name in _PLACES:
        value = getattr(import_module(f"sixsps.{_PLACES[name]}"), name)
    elif name in _MODULES:
        value = import_module(f"sixsps.{name}")
    else:
        raise AttributeError(f"module 'sixsps' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
