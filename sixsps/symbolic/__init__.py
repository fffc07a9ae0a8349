"""CasADi model of the hexapod: one symbolic source that is run in three ways, and its exact derivatives.

CasADi evaluates these functions, `sixsps.kernels` lowers them to machine code, and `sixsps export c`
writes them as C. They share with the other formulations no formula for leg motion, partial velocities or
inertia forces: see `leg.py` and `model.py` for what is written down and what is differentiated.

Derivatives with respect to the pose are taken on the rotation group: the pose is perturbed to
(P + dp, exp([dtheta]x) R), a left perturbation in world axes, while twist, acceleration and external
wrench keep their world components. In this convention length_rates = (d lengths / d pose) [v; omega].

Every function takes column vectors, or matrices with one sample a column:
pose (7,) = [P, quaternion w x y z], twist (6,) = [v, omega], acceleration (6,) = [a, epsilon],
wrench (6,) = [F_w, m_w], parameters (97,) as in `PARAMETERS`. SI units, world axes.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from sixsps.arrays import Array
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.parameters import MOTION_COLUMNS
from sixsps.parameters import PARAMETERS as PARAMETERS
from sixsps.parameters import parameter_vector as parameter_vector
from sixsps.sources import MODEL, digest
from sixsps.symbolic import derivatives
from sixsps.symbolic.model import Model
from sixsps.symbolic.slopes import NAMES
from sixsps.symbolic.solve import Factors, regularity

SOURCE_DIGEST = digest(*MODEL)
"""Of the source that this process runs."""

_POSE = ("pose", "parameters")
_TWIST = ("pose", "twist", "parameters")
_ACCELERATION = ("pose", "twist", "acceleration", "parameters")
_MOTION = ("pose", "twist", "acceleration", "wrench", "parameters")


def motion_columns(motion: Motion) -> dict[str, Array]:
    """Returns pose (7, n), twist, acceleration and wrench (6, n) of a motion, one sample a column."""
    return {
        name: np.hstack([getattr(motion, array) for array, _ in arrays]).T
        for name, arrays in MOTION_COLUMNS.items()
    }


@lru_cache(maxsize=1)
def _model() -> Model:
    return Model()


@lru_cache(maxsize=1)
def lengths() -> ca.Function:
    """Returns the function (pose, parameters) -> lengths (6,) [m]."""
    return _function("lengths", _POSE, {"lengths": _of_legs("length")})


@lru_cache(maxsize=1)
def jacobian() -> ca.Function:
    """Returns the function (pose, parameters) -> jacobian (6, 6), the derivative of `lengths`."""
    return _function("jacobian", _POSE, {"jacobian": _model().jacobian().T})


@lru_cache(maxsize=1)
def leg_motion() -> ca.Function:
    """Returns (pose, twist, acceleration, parameters) -> lengths, length_rates, length_accelerations (6,)."""
    names = {"lengths": "length", "length_rates": "rate", "length_accelerations": "acceleration"}
    outputs = {output: _of_legs(name) for output, name in names.items()}
    return _function("leg_motion", _ACCELERATION, outputs)


@lru_cache(maxsize=1)
def equations() -> ca.Function:
    """Returns (pose, twist, acceleration, wrench, parameters) -> J (6, 6), C (6,) of J F = C."""
    model = _model()
    return _function("equations", _MOTION, {"J": model.jacobian(), "C": model.actuator_wrench()})


@lru_cache(maxsize=1)
def forces() -> ca.Function:
    """Returns (pose, twist, acceleration, wrench, parameters) -> F (6,) [N], regularity.

    regularity is a lower bound of cond(J)^-2, moments over the RMS platform radius; or the square of
    the shortest leg over that radius, where this is less.
    """
    return _function("forces", _MOTION, {"F": _forces(), "regularity": _regularity()})


@lru_cache(maxsize=1)
def force_derivatives() -> ca.Function:
    """Returns the function from the inputs of `forces` to its outputs and the exact derivatives of F.

    by_pose (6, 6) for a left perturbation [dp; dtheta] in world axes, by_twist, by_acceleration and
    by_wrench (6, 6): the three functions of `force_derivative_steps` joined.
    """
    head, leg, tail = force_derivative_steps()
    inputs = {name: _model().inputs[name] for name in _MOTION}
    known = head.call(inputs)
    rows = []
    for k in range(6):
        one = leg.call({"legs": known["legs"][k, :], "shared": known["shared"], "sums": known["sums"]})
        known["sums"] = one["total"]
        rows.append(one["rows"])
    known["rows"] = ca.vertcat(*rows)
    slopes = tail.call({name: known[name] for name in tail.name_in()})
    names = ("F", *NAMES, "by_wrench", "regularity")
    return _function("force_derivatives", _MOTION, {name: (known | slopes)[name] for name in names})


@lru_cache(maxsize=1)
def force_derivative_steps() -> tuple[ca.Function, ca.Function, ca.Function]:
    """Returns the three functions that `force_derivatives` is made of; see `derivatives.py`."""
    model, F = _model(), _forces()
    points, spread = model.platform_slopes()
    outputs = {
        "F": F,
        "by_wrench": _inverse() @ model.wrench_slope(),
        "inverse": _inverse(),
        **derivatives.head(model.states, F, model.omega, model.epsilon, model.gravity, points, spread),
        "regularity": _regularity(),
    }
    return (
        _function("force_derivatives_head", _MOTION, outputs),
        _joined("force_derivatives_leg", *derivatives.leg_step()),
        _joined("force_derivatives_tail", *derivatives.tail_step()),
    )


@lru_cache(maxsize=1)
def parameter_derivatives() -> ca.Function:
    """Returns the function from the inputs of `forces` to by_parameters (6, 97).

    The exact derivatives of F with respect to every entry of `PARAMETERS`.
    """
    model = _model()
    held = ca.SX.sym("F", 6)
    residual = model.actuator_wrench() - model.jacobian() @ held
    slopes = ca.substitute(ca.jacobian(residual, model.inputs["parameters"]), held, _forces())
    outputs = {"by_parameters": _inverse() @ slopes, "regularity": _regularity()}
    return _function("parameter_derivatives", _MOTION, outputs)


@lru_cache(maxsize=1)
def energy() -> ca.Function:
    """Returns the function (pose, twist, parameters) -> kinetic, potential energy [J]."""
    model = _model()
    outputs = {"kinetic": model.kinetic_energy(), "potential": model.potential_energy()}
    return _function("energy", _TWIST, outputs)


@lru_cache(maxsize=1)
def energy_rate() -> ca.Function:
    """Returns the function (pose, twist, acceleration, parameters) -> rate of total energy [W]."""
    model = _model()
    total = model.kinetic_energy() + model.potential_energy()
    pose, twist = model.inputs["pose"], model.inputs["twist"]
    w, vector = pose[3], pose[4:]
    # q' = (0, omega) q / 2, the quaternion of world-frame omega.
    turning = ca.vertcat(-ca.dot(model.omega, vector), w * model.omega + ca.cross(model.omega, vector)) / 2
    change = ca.vertcat(model.velocity, turning, model.inputs["acceleration"])
    rate = ca.jtimes(total, ca.vertcat(pose, twist), change)
    return _function("energy_rate", _ACCELERATION, {"rate": rate})


def evaluate(function: ca.Function, mechanism: Mechanism, motion: Motion) -> dict[str, Array]:
    """Evaluates one of this module's functions at every sample of a motion.

    Args:
        function: with inputs named as in the module's description.
        mechanism: gives the parameters.
        motion: n samples.

    Returns:
        Output name -> (n, rows, columns), or (n, rows) where the output is a column vector.

    Raises:
        MechanismError: the output needs inertia, and the mechanism is geometry alone.
    """
    columns = motion_columns(motion)
    columns["parameters"] = parameter_vector(mechanism)[:, None]
    # CasADi evaluates every sample that shares one column of parameters in a single call.
    inputs = [ca.DM(columns[function.name_in(i)]) for i in range(function.n_in())]
    results = function.call(inputs) if len(motion) else []
    sizes = [(function.name_out(i), function.size_out(i)) for i in range(function.n_out())]
    stacked = {name: np.empty((0, *size) if size[1] > 1 else (0, size[0])) for name, size in sizes}
    for index, result in enumerate(results):
        rows, width = function.size_out(index)
        blocks = np.asarray(result.full()).reshape(rows, len(motion), width).swapaxes(0, 1)
        stacked[function.name_out(index)] = blocks[..., 0] if width == 1 else blocks
    if any(np.isnan(values).any() for values in stacked.values()):
        mechanism.check_inertia()
    return stacked


def _of_legs(name: str) -> ca.SX:
    return ca.vertcat(*(getattr(one, name) for one in _model().legs))


@lru_cache(maxsize=1)
def _factors() -> Factors:
    return Factors(_metric(_model().jacobian()))


def _metric(rows: ca.SX) -> ca.SX:
    """Rows of forces and of moments, these divided by the RMS platform radius."""
    return ca.vertcat(rows[:3, :], rows[3:, :] / _model().radius)


def _forces() -> ca.SX:
    return _factors().solve(_metric(_model().actuator_wrench()))


@lru_cache(maxsize=1)
def _inverse() -> ca.SX:
    """Returns J^-1."""
    return _metric(_factors().inverse().T).T


def _regularity() -> ca.SX:
    # Directions are unit vectors, arms over their RMS length have squares that sum to 6.
    bound = regularity(_factors().determinant_squared, 12.0)
    for one in _model().legs:
        bound = ca.fmin(bound, (one.length / _model().radius) ** 2)
    return bound


def _joined(name: str, inputs: dict[str, ca.SX], outputs: dict[str, ca.SX]) -> ca.Function:
    expressions = ca.cse([ca.densify(output) for output in outputs.values()])
    return ca.Function(name, list(inputs.values()), expressions, list(inputs), list(outputs))


def _function(name: str, inputs: tuple[str, ...], outputs: dict[str, ca.SX]) -> ca.Function:
    return _joined(name, {key: _model().inputs[key] for key in inputs}, outputs)
