"""The folder that a simulation leaves behind, and what the terminal says of it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from compare.simulation.simulate import Simulation
from compare.simulation.trajectory import Trajectory
from sixsps.arrays import Array
from sixsps.files import write_json
from sixsps.tables import write_table

SIMULATION, TRAJECTORY, ERRORS = "simulation.json", "trajectory.parquet", "errors.parquet"
_AXES = ("x", "y", "z")


def write_simulation(simulation: Simulation, command: str, folder: Path) -> None:
    """Writes `trajectory.parquet`, `errors.parquet` and `simulation.json` into an existing folder.

    Args:
        simulation: what to write.
        command: that it came from.
        folder: existing folder.

    Raises:
        OutputError: a file cannot be written.
    """
    outcome = simulation.outcome
    write_table(motion_columns(outcome.trajectory), folder / TRAJECTORY)
    write_table(error_columns(outcome.trajectory, simulated=outcome.simulated), folder / ERRORS)
    facts = simulation.facts | {"command": command}
    write_json(facts, folder / SIMULATION)


def motion_columns(path: Trajectory) -> dict[str, Array]:
    """Returns the columns of `trajectory.parquet`, a motion file.

    Where only accelerations are simulated, pose and twist are the planned ones.

    Args:
        path: k samples.
    """
    state = path.state
    quaternion = state.quaternion / np.linalg.norm(state.quaternion, axis=1, keepdims=True)
    table = {"t": path.planned.time}
    table |= _named(_AXES, state.position) | _named(("qw", "qx", "qy", "qz"), quaternion)
    table |= _named(("vx", "vy", "vz"), state.velocity) | _named(("wx", "wy", "wz"), state.angular_velocity)
    table |= _named(("ax", "ay", "az", "ex", "ey", "ez"), path.accelerations)
    return (
        table
        | _named(("fx", "fy", "fz"), path.planned.force)
        | _named(("mx", "my", "mz"), path.planned.moment)
    )


def error_columns(path: Trajectory, *, simulated: bool) -> dict[str, Array]:
    """Returns the columns of `errors.parquet`.

    Leg forces f1..f6 and, with a PD, its part feedback1..6 [N]; errors against the plan:
    position_error [m], orientation_error [rad], acceleration_error [m/s^2],
    angular_acceleration_error [rad/s^2]; closure_error [m].

    Args:
        path: k samples.
        simulated: whether pose and twist are.
    """
    table = {"t": path.planned.time} | _named([f"f{leg}" for leg in range(1, 7)], path.forces)
    if path.feedback is not None:
        table |= _named([f"feedback{leg}" for leg in range(1, 7)], path.feedback)
    if simulated:
        table |= {"position_error": path.position_error(), "orientation_error": path.orientation_error()}
    linear, angular = path.acceleration_error()
    table |= {"acceleration_error": linear, "angular_acceleration_error": angular}
    return table | {"closure_error": path.closure_error}


def _named(names: tuple[str, ...] | list[str], values: Array) -> dict[str, Array]:
    return dict(zip(names, np.ascontiguousarray(values.T), strict=True))


def summary(facts: dict[str, Any]) -> Iterator[str]:
    """Yields what a person at a terminal reads, in lines of 80 columns.

    Args:
        facts: content of `simulation.json`.
    """
    mechanism, motion = facts["mechanism"]["name"], facts["motion"]["name"]
    yield f"{facts['engine']} ({facts['version']}), {facts['mode']}: {mechanism} along {motion}"[:80]
    yield from (f"{name:<26}{value}" for name, value in _figures(facts))
    stop = facts["stopped"]
    if stop is None:
        yield f"complete: {facts['samples']} samples"
    else:
        yield f"stopped at t = {stop['t']:g} s, {facts['samples']} samples kept"


def _figures(facts: dict[str, Any]) -> Iterator[tuple[str, str]]:
    if facts["mode"] == "recover":
        linear = _short(facts["max_acceleration_error_m_s2"])
        angular = _short(facts["max_angular_acceleration_error_rad_s2"])
        yield "acceleration error", f"{_short(facts['max_acceleration_error'])} of the largest acceleration"
        yield "", f"{linear} m/s^2, {angular} rad/s^2"
    else:
        yield (
            "tracking error",
            f"{_short(facts['max_position_error_m'])} m, {_short(facts['max_orientation_error_rad'])} rad",
        )
    if facts["max_feedback_force_N"] is not None:
        yield "PD force needed", f"{_short(facts['max_feedback_force_N'])} N"
    if facts["horizon_s"] is not None:
        lost = facts["settings"]["lost_m"]
        yield "horizon", f"{facts['horizon_s']:.4g} s, up to which errors stay below {lost:g} m"
        if facts["growth_rate_per_s"] is not None:
            yield "growth measured", f"{facts['growth_rate_per_s']:.4g} 1/s up to there"
        there, anywhere = facts["eigenvalue_per_s"], facts["largest_eigenvalue_per_s"]
        yield "largest eigenvalue", f"{there:.4g} 1/s up to there, {anywhere:.4g} 1/s in all"
    if facts.get("max_relative_force_difference") is not None:
        relative, transient = facts["max_relative_force_difference"], facts["transient_s"]
        yield "multipliers off forces", f"{_short(relative)} of the largest, after {transient:.2g} s"
        yield "integrator's estimate", f"{_short(facts['force_error_estimate_N'])} N"
    yield "gap of the loops", f"{_short(facts['max_closure_error_m'])} m"


def _short(value: float | None) -> str:
    return "no number" if value is None else f"{value:.1e}" if value else "0"
