"""Exact derivatives against the forces alone, against differences of forces, and against CasADi."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

import sixsps
from benchmarks import naming
from benchmarks.plan import Plan
from benchmarks.rounds import Contestant, Progress, interleaved
from benchmarks.states import States
from sixsps import symbolic
from sixsps.arrays import Array
from sixsps.kernels.graph import graph
from sixsps.kernels.model import CompiledMechanism
from sixsps.kernels.signatures import FORCE_DERIVATIVES, FORCES
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.parameters import MOTION_COLUMNS

BLOCKS = ("by_pose", "by_twist", "by_acceleration", "by_wrench")
# Forces are quadratic in the twist and linear in acceleration and wrench: any step is exact there. Of the
# pose, cube root of unit roundoff balances rounding and truncation.
_POSE_STEP, _STEP = 6e-6, 1.0


class Differences:
    """Central differences of `fast` in 24 directions: 48 evaluations.

    Args:
        model: gives the forces.
        motion: n states; those around them are made here, not while it is timed.
    """

    def __init__(self, model: CompiledMechanism, motion: Motion) -> None:
        self._model = model
        self._steps = np.repeat([_POSE_STEP, _STEP], [6, 18])
        self._around = [(moved(motion, k, h), moved(motion, k, -h)) for k, h in enumerate(self._steps)]

    def evaluate(self) -> Array:
        """Returns the (24, n, 6) slopes of the forces."""
        slopes = []
        for (ahead, behind), step in zip(self._around, self._steps, strict=True):
            rise = self._model.inverse_dynamics(ahead) - self._model.inverse_dynamics(behind)
            slopes.append(rise / (2 * step))
        return np.array(slopes)


def moved(motion: Motion, direction: int, step: float) -> Motion:
    """Returns a motion with every sample moved in one of 24 directions.

    Args:
        motion: n samples.
        direction: 0..23: [dp; dtheta], twist, acceleration, wrench, world axes.
        step: how far.
    """
    name, axis = _DIRECTIONS[direction]
    arrays: dict[str, Any] = {
        one: np.array(getattr(motion, one)) for pair in MOTION_COLUMNS.values() for one, _ in pair
    }
    if name == "quaternion":
        arrays[name] = _turned(arrays[name], axis, step)
    else:
        arrays[name][:, axis] += step
    return Motion(time=motion.time, **arrays)


def _all_directions() -> Iterator[tuple[str, int]]:
    for arrays in MOTION_COLUMNS.values():
        for name, _ in arrays:
            yield from ((name, axis) for axis in range(3))


_DIRECTIONS = tuple(_all_directions())


def _turned(quaternion: Array, axis: int, angle: float) -> Array:
    """Returns exp([angle e_axis]x) R as quaternions."""
    w, vector = quaternion[:, :1], quaternion[:, 1:]
    half, unit = np.sin(angle / 2), np.eye(3)[axis]
    scalar = np.cos(angle / 2) * w - half * vector[:, axis, None]
    return np.hstack([scalar, np.cos(angle / 2) * vector + half * (w * unit + np.cross(unit, vector))])


def measure(plan: Plan, states: States, progress: Progress) -> dict[str, Any]:
    """Returns the entry `derivatives` of the results; all on one thread."""
    progress("setting up")
    mechanism, motion = states.mechanism, states.spread(plan.slopes)
    model = sixsps.compile(mechanism, 1)
    few = motion[: max(1, plan.slopes // 20)]
    differences = Differences(model, motion)
    n, out = len(motion), np.empty((len(motion), 6))
    there = model.inverse_dynamics_derivatives(motion)
    found: dict[str, tuple[str, int, Callable[[], Any]]] = {
        naming.FORCES: ("`inverse_dynamics`", n, partial(model.inverse_dynamics, motion)),
        naming.FORCES_REUSED: ("with `out`", n, partial(model.inverse_dynamics, motion, out)),
        naming.EXACT: (
            "`inverse_dynamics_derivatives`",
            n,
            partial(model.inverse_dynamics_derivatives, motion),
        ),
        naming.EXACT_REUSED: ("with `out`", n, partial(model.inverse_dynamics_derivatives, motion, there)),
        naming.DIFFERENCES: ("central differences of `fast`: 48 evaluations", n, differences.evaluate),
        naming.CASADI: ("by CasADi's VM, mapped", len(few), partial(_casadi, mechanism, few)),
    }
    contestants = [Contestant(name, units, run) for name, (_, units, run) in found.items()]
    times = interleaved(contestants, plan.rounds, plan.turn, progress)
    rows = [
        {"name": name, "what": what, "samples": units, "ns_per_sample": times[name]}
        for name, (what, units, _) in found.items()
    ]
    exact = exact_slopes(model, motion)
    return {
        "rows": rows,
        "flops": {one.name: graph(one.name).flops for one in (FORCES, FORCE_DERIVATIVES)},
        "difference": _largest(differences.evaluate() - exact) / _largest(exact),
    }


def exact_slopes(model: CompiledMechanism, motion: Motion) -> Array:
    """Returns the (24, n, 6) exact derivatives in the order of `moved`."""
    found = model.inverse_dynamics_derivatives(motion)
    return np.concatenate([getattr(found, name).transpose(2, 0, 1) for name in BLOCKS])


def _casadi(mechanism: Mechanism, motion: Motion) -> dict[str, Array]:
    return symbolic.evaluate(symbolic.force_derivatives(), mechanism, motion)


def _largest(values: Array) -> float:
    return float(np.abs(values).max())
