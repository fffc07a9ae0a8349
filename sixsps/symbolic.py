"""CasADi model of the hexapod: everything that is a derivative is differentiated, not written down.

Written down are leg lengths and centres of mass as functions of the platform pose, that a leg does
not spin (omega = s x s'), and the angular momentum I omega of a body. The Jacobian, partial
velocities, velocities, accelerations and rates of momentum come from them by algorithmic
differentiation; none of the formulas of `kinematics.py` and `formulations/kane.py` for these is used.

Differentiation along a motion treats R as nine numbers with R' = [omega]x R and
[v; omega]' = [a; epsilon]. Derivatives with respect to the pose are taken on the rotation group:
the pose is perturbed to (P + dp, exp([dtheta]x) R), a left perturbation in world axes, while twist,
acceleration and external wrench keep their world components. In this convention
length_rates = (d lengths / d pose) [v; omega].

Every function takes column vectors, or matrices with one sample a column:
pose (7,) = [P, quaternion w x y z], twist (6,) = [v, omega], acceleration (6,) = [a, epsilon],
wrench (6,) = [F_w, m_w], parameters (97,) as in `PARAMETERS`. SI units, world axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from sixsps.arrays import Array
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

_AXES = "xyz"
_LINK_FIELDS = ("mass", "com", "transverse", "axial")
_INERTIA = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}

PARAMETERS: tuple[str, ...] = (
    *(f"gravity.{axis}" for axis in _AXES),
    *(f"base.anchors.{leg}.{axis}" for leg in range(6) for axis in _AXES),
    *(f"platform.anchors.{leg}.{axis}" for leg in range(6) for axis in _AXES),
    "platform.mass",
    *(f"platform.com.{axis}" for axis in _AXES),
    *(f"platform.inertia.{entry}" for entry in _INERTIA),
    *(
        f"legs.{leg}.{half}.{field}"
        for leg in range(6)
        for half in ("lower", "upper")
        for field in _LINK_FIELDS
    ),
)
"""Names of the entries of the parameter vector, in order."""


def parameter_vector(mechanism: Mechanism) -> Array:
    """Returns the (97,) numbers of a mechanism in the order of `PARAMETERS`, SI units."""
    inertia = mechanism.platform.inertia
    links = [link for leg in mechanism.legs for link in (leg.lower, leg.upper)]
    return np.concatenate(
        [
            mechanism.gravity,
            mechanism.base_anchors.ravel(),
            mechanism.platform_anchors.ravel(),
            [mechanism.platform.mass],
            mechanism.platform.com,
            [inertia[entry] for entry in _INERTIA.values()],
            [getattr(link, field) for link in links for field in _LINK_FIELDS],
        ]
    )


def motion_columns(motion: Motion) -> dict[str, Array]:
    """Returns pose (7, n), twist, acceleration and wrench (6, n) of a motion, one sample a column."""
    return {
        "pose": np.hstack([motion.position, motion.quaternion]).T,
        "twist": np.hstack([motion.velocity, motion.angular_velocity]).T,
        "acceleration": np.hstack([motion.acceleration, motion.angular_acceleration]).T,
        "wrench": np.hstack([motion.force, motion.moment]).T,
    }


@dataclass(frozen=True, eq=False)
class _State:
    """Symbols of the platform's motion, with the rotation matrix as nine independent numbers."""

    position: ca.SX
    rotation: ca.SX
    twist: ca.SX
    acceleration: ca.SX
    wrench: ca.SX
    parameters: ca.SX

    @classmethod
    def symbols(cls) -> _State:
        sizes = {"position": 3, "rotation": (3, 3), "twist": 6, "acceleration": 6, "wrench": 6}
        made = {
            name: ca.SX.sym(name, *(size if isinstance(size, tuple) else (size,)))
            for name, size in sizes.items()
        }
        return cls(**made, parameters=ca.SX.sym("parameters", len(PARAMETERS)))

    def rate(self, expression: ca.SX) -> ca.SX:
        """Returns the time derivative of an expression in position, rotation and twist."""
        turning = ca.skew(self.twist[3:]) @ self.rotation
        state = ca.vertcat(self.position, ca.vec(self.rotation), self.twist)
        change = ca.vertcat(self.twist[:3], ca.vec(turning), self.acceleration)
        return ca.jtimes(expression, state, change)

    def pose_jacobian(self, expression: ca.SX) -> ca.SX:
        """Returns the derivative with respect to a left perturbation [dp; dtheta], world axes."""
        turned = [ca.vec(ca.skew(axis) @ self.rotation) for axis in ca.horzsplit(ca.SX.eye(3))]
        by_rotation = ca.jacobian(expression, ca.vec(self.rotation)) @ ca.horzcat(*turned)
        return ca.horzcat(ca.jacobian(expression, self.position), by_rotation)


@dataclass(frozen=True, eq=False)
class _Body:
    """A rigid body: centre of mass, angular velocity, angular momentum about the com, mass."""

    com: ca.SX
    angular_velocity: ca.SX
    spin: ca.SX
    mass: ca.SX


@dataclass(frozen=True, eq=False)
class _Model:
    """Expressions of the whole mechanism, in the symbols of `state`."""

    state: _State
    lengths: ca.SX
    bodies: tuple[_Body, ...]
    gravity: ca.SX


class _Parameters:
    """The parameter vector read from front to back."""

    def __init__(self, vector: ca.SX) -> None:
        self._vector, self._next = vector, 0

    def take(self, size: int) -> ca.SX:
        start, self._next = self._next, self._next + size
        return self._vector[start : self._next]


@lru_cache(maxsize=1)
def _model() -> _Model:
    state = _State.symbols()
    parameters = _Parameters(state.parameters)
    gravity = parameters.take(3)
    base = ca.reshape(parameters.take(18), 3, 6)
    anchors = ca.reshape(parameters.take(18), 3, 6)
    bodies = [_platform(state, parameters.take(10))]
    lengths = []
    for leg in range(6):
        joint = state.position + state.rotation @ anchors[:, leg]
        vector = joint - base[:, leg]
        length = ca.sqrt(ca.dot(vector, vector))
        lengths.append(length)
        bodies += _links(state, base[:, leg], joint, vector / length, parameters.take(8))
    return _Model(state, ca.vertcat(*lengths), tuple(bodies), gravity)


def _platform(state: _State, parameters: ca.SX) -> _Body:
    mass, com = parameters[0], parameters[1:4]
    xx, yy, zz, xy, xz, yz = ca.vertsplit(parameters[4:])
    inertia = ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))
    R, omega = state.rotation, state.twist[3:]
    return _Body(state.position + R @ com, omega, R @ inertia @ R.T @ omega, mass)


def _links(state: _State, base: ca.SX, joint: ca.SX, direction: ca.SX, parameters: ca.SX) -> list[_Body]:
    omega = ca.cross(direction, state.rate(direction))  # the leg does not spin about itself
    along = direction @ direction.T
    bodies = []
    for foot, sense, values in ((base, 1, parameters[:4]), (joint, -1, parameters[4:])):
        mass, com, transverse, axial = ca.vertsplit(values)
        inertia = transverse * (ca.SX.eye(3) - along) + axial * along
        bodies.append(_Body(foot + sense * com * direction, omega, inertia @ omega, mass))
    return bodies


def _jacobian(model: _Model) -> ca.SX:
    return model.state.pose_jacobian(model.lengths)


def _actuator_wrench(model: _Model) -> ca.SX:
    """C: what the actuators must exert, by d'Alembert's principle in Jourdain's form."""
    state = model.state
    wrench = ca.SX.zeros(6)
    for body in model.bodies:
        velocity = state.rate(body.com)
        force = body.mass * (state.rate(velocity) - model.gravity)
        wrench += ca.jacobian(velocity, state.twist).T @ force
        wrench += ca.jacobian(body.angular_velocity, state.twist).T @ state.rate(body.spin)
    platform = model.bodies[0]
    wrench -= ca.jacobian(state.rate(platform.com), state.twist).T @ state.wrench[:3]
    wrench -= ca.jacobian(platform.angular_velocity, state.twist).T @ state.wrench[3:]
    return wrench


def _energy(model: _Model) -> tuple[ca.SX, ca.SX]:
    kinetic = potential = ca.SX(0)
    for body in model.bodies:
        velocity = model.state.rate(body.com)
        kinetic += (body.mass * ca.dot(velocity, velocity) + ca.dot(body.angular_velocity, body.spin)) / 2
        potential -= body.mass * ca.dot(model.gravity, body.com)
    return kinetic, potential


@lru_cache(maxsize=1)
def lengths() -> ca.Function:
    """Returns the function (pose, parameters) -> lengths (6,) [m]."""
    model = _model()
    return _function("lengths", {}, {"lengths": model.lengths})


@lru_cache(maxsize=1)
def jacobian() -> ca.Function:
    """Returns the function (pose, parameters) -> jacobian (6, 6), the derivative of `lengths`."""
    model = _model()
    return _function("jacobian", {}, {"jacobian": _jacobian(model)})


@lru_cache(maxsize=1)
def equations() -> ca.Function:
    """Returns (pose, twist, acceleration, wrench, parameters) -> J (6, 6), C (6,) of J F = C."""
    model = _model()
    outputs = {"J": _jacobian(model).T, "C": _actuator_wrench(model)}
    return _function("equations", _motion_inputs(), outputs)


@lru_cache(maxsize=1)
def forces() -> ca.Function:
    """Returns (pose, twist, acceleration, wrench, parameters) -> F (6,) [N], by Householder QR."""
    inputs = _numeric_inputs()
    J, C = equations()(*inputs.values())
    return ca.Function("forces", list(inputs.values()), [_solve(J, C, inputs)], list(inputs), ["F"])


@lru_cache(maxsize=1)
def force_derivatives() -> ca.Function:
    """Returns the function from the inputs of `forces` to the exact derivatives of F.

    Outputs: by_pose (6, 6) for a left perturbation [dp; dtheta] in world axes, by_twist,
    by_acceleration and by_wrench (6, 6). From J F = C they solve J dF = dC - dJ F.
    """
    model = _model()
    slopes = {"by_pose": model.state.pose_jacobian(_residual(model))}
    for name, symbol in _motion_inputs().items():
        slopes[f"by_{name}"] = ca.jacobian(_residual(model), symbol)
    return _derivatives_of_forces("force_derivatives", slopes)


@lru_cache(maxsize=1)
def parameter_derivatives() -> ca.Function:
    """Returns the function from the inputs of `forces` to by_parameters (6, 97).

    The exact derivatives of F with respect to every entry of `PARAMETERS`.
    """
    model = _model()
    slopes = {"by_parameters": ca.jacobian(_residual(model), model.state.parameters)}
    return _derivatives_of_forces("parameter_derivatives", slopes)


@lru_cache(maxsize=1)
def energy() -> ca.Function:
    """Returns the function (pose, twist, parameters) -> kinetic, potential energy [J]."""
    model = _model()
    kinetic, potential = _energy(model)
    outputs = {"kinetic": kinetic, "potential": potential}
    return _function("energy", {"twist": model.state.twist}, outputs)


@lru_cache(maxsize=1)
def energy_rate() -> ca.Function:
    """Returns the function (pose, twist, acceleration, parameters) -> rate of total energy [W]."""
    state = _model().state
    kinetic, potential = _energy(_model())
    rate = state.rate(kinetic + potential)
    inputs = {"twist": state.twist, "acceleration": state.acceleration}
    return _function("energy_rate", inputs, {"rate": rate})


def evaluate(function: ca.Function, mechanism: Mechanism, motion: Motion) -> dict[str, Array]:
    """Evaluates one of this module's functions at every sample of a motion.

    Args:
        function: with inputs named as in the module's description.
        mechanism: gives the parameters.
        motion: n samples.

    Returns:
        Output name -> (n, rows, columns), or (n, rows) where the output is a column vector.
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
    return stacked


def _motion_inputs() -> dict[str, ca.SX]:
    state = _model().state
    return {"twist": state.twist, "acceleration": state.acceleration, "wrench": state.wrench}


def _numeric_inputs() -> dict[str, ca.MX]:
    function = equations()
    return {
        function.name_in(i): ca.MX.sym(function.name_in(i), *function.size_in(i))
        for i in range(function.n_in())
    }


def _solve(J: ca.MX, right: ca.MX, inputs: dict[str, ca.MX]) -> ca.MX:
    """Solves J x = right with the moment rows divided by the RMS platform radius."""
    first = PARAMETERS.index("platform.anchors.0.x")
    radius = ca.norm_2(inputs["parameters"][first : first + 18]) / np.sqrt(6)
    scale = ca.vertcat(ca.MX.ones(3), ca.MX.ones(3) / radius)
    return ca.solve(ca.diag(scale) @ J, ca.diag(scale) @ right, "lapackqr")


@lru_cache(maxsize=1)
def _unknown_forces() -> ca.SX:
    return ca.SX.sym("F", 6)


def _residual(model: _Model) -> ca.SX:
    """J F - C at given forces, whose slopes give the derivatives of the F that makes it vanish."""
    return _jacobian(model).T @ _unknown_forces() - _actuator_wrench(model)


def _derivatives_of_forces(name: str, slopes: dict[str, ca.SX]) -> ca.Function:
    inputs = _numeric_inputs()
    J, C = equations()(*inputs.values())
    F = {"F": _unknown_forces()}
    function = _function(f"{name}_slopes", _motion_inputs(), slopes, F)
    values = function.call([_solve(J, C, inputs), *inputs.values()])
    outputs = [_solve(J, -ca.densify(value), inputs) for value in values]
    return ca.Function(name, list(inputs.values()), outputs, list(inputs), list(slopes))


def _function(
    name: str,
    inputs: dict[str, ca.SX],
    outputs: dict[str, ca.SX],
    before: dict[str, ca.SX] | None = None,
) -> ca.Function:
    """Returns a function of (before..., pose, inputs..., parameters), quaternion normalised inside."""
    state = _model().state
    pose = ca.SX.sym("pose", 7)
    old, new = [state.position, state.rotation], [pose[:3], _rotation(pose[3:])]
    expressions = ca.cse(ca.substitute(list(outputs.values()), old, new))
    symbols = {**(before or {}), "pose": pose, **inputs, "parameters": state.parameters}
    return ca.Function(name, list(symbols.values()), expressions, list(symbols), list(outputs))


def _rotation(quaternion: ca.SX) -> ca.SX:
    w, x, y, z = ca.vertsplit(quaternion / ca.norm_2(quaternion))
    return ca.vertcat(
        ca.horzcat(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        ca.horzcat(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        ca.horzcat(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
