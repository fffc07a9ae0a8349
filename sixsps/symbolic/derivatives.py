"""Exact derivatives of the leg forces, in three steps: before the legs, one leg, after the legs.

From J F = C follows J dF = dC - dJ F. The step of one leg is the same for all six: whoever writes these
functions out as code can do so once, and loop. Joined they are one function.

head: motion, parameters -> F (6,), by_wrench (6, 6), inverse (6, 6) of J, legs (6, LEG) a row a leg,
    shared (9,) omega, epsilon, gravity, sums (SUMS,), regularity
leg: legs (1, LEG) one row, shared, sums -> rows (1, 18), total (SUMS,), the sums with this leg
tail: inverse, shared, sums, rows (6, 18) -> by_pose, by_twist, by_acceleration (6, 6)
"""

from __future__ import annotations

import casadi as ca

from sixsps.symbolic.leg import LegState, leg_slopes
from sixsps.symbolic.slopes import NAMES, JointMotion, Points, Slopes

LEG = LegState.SIZE + 1
SUMS = Points.SIZE + 3 * 36
_ROW = 3 * 6


def head(
    states: list[LegState],
    forces: ca.SX,
    omega: ca.SX,
    epsilon: ca.SX,
    gravity: ca.SX,
    points: Points,
    spread: Slopes,
) -> dict[str, ca.SX]:
    """Returns what the legs and the tail need.

    Args:
        states: of the six legs.
        forces: F (6,).
        omega: (3,) of the platform.
        epsilon: (3,) of the platform.
        gravity: (3,).
        points: the platform's mass.
        spread: slopes of what the platform's turning takes.
    """
    rows = [ca.vertcat(one.packed(), forces[k]).T for k, one in enumerate(states)]
    return {
        "legs": ca.vertcat(*rows),
        "shared": ca.vertcat(omega, epsilon, gravity),
        "sums": ca.vertcat(points.packed(), spread.packed()),
    }


def leg_step() -> tuple[dict[str, ca.SX], dict[str, ca.SX]]:
    """Returns inputs and outputs of the step of one leg."""
    legs, shared, sums = ca.SX.sym("legs", 1, LEG), ca.SX.sym("shared", 9), ca.SX.sym("sums", SUMS)
    omega, epsilon, gravity = ca.vertsplit(shared, 3)
    state = LegState.unpacked(legs[:-1].T, gravity)
    slopes = leg_slopes(state, legs[-1])
    joint = JointMotion(state.arm, omega, epsilon)
    points = Points.unpacked(sums[: Points.SIZE]) + Points.one(state.arm, slopes.equal, slopes.force)
    spread = Slopes.unpacked(sums[Points.SIZE :], 6) + joint.spread(slopes)
    outputs = {
        "rows": joint.own(slopes).packed().T,
        "total": ca.vertcat(points.packed(), spread.packed()),
    }
    return {"legs": legs, "shared": shared, "sums": sums}, outputs


def tail_step() -> tuple[dict[str, ca.SX], dict[str, ca.SX]]:
    """Returns inputs and outputs of the step after the legs."""
    inverse, shared = ca.SX.sym("inverse", 6, 6), ca.SX.sym("shared", 9)
    sums, rows = ca.SX.sym("sums", SUMS), ca.SX.sym("rows", 6, _ROW)
    omega, epsilon, _ = ca.vertsplit(shared, 3)
    spread = Slopes.unpacked(sums[Points.SIZE :], 6)
    spread += Points.unpacked(sums[: Points.SIZE]).slopes(omega, epsilon)
    own = ca.horzsplit(rows, 6)
    pairs = zip(NAMES, spread.all(), own, strict=True)
    outputs = {name: inverse @ wrenches + row for name, wrenches, row in pairs}
    return {"inverse": inverse, "shared": shared, "sums": sums, "rows": rows}, outputs
