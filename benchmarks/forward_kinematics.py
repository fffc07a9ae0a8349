"""Forward kinematics: along a trajectory, one call at a time, and random poses of whole workspaces."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import sixsps
from benchmarks.latency import Caller, summary, timed
from benchmarks.naming import on_threads
from benchmarks.plan import Plan
from benchmarks.rounds import Contestant, Progress, interleaved, undisturbed
from benchmarks.states import States
from benchmarks.workers import thread_counts
from benchmarks.workspace_poses import workspace_poses
from sixsps.arrays import Array
from sixsps.home import home_position
from sixsps.mechanism import Mechanism
from sixsps.platform_pose import STATUSES
from sixsps.trajectories import bundled

FOLLOWED, NEXT, FROM_HOME, PLAIN = "poses along lengths", "next pose", "pose from home", "plain function"
MECHANISMS = ("wu2012", "tsai2000", "taghirad2013")
_UNIT_ROUNDOFF = 2.0**-53
# Beyond this distance, in sizes of the platform and radians, a pose is another one.
_ANOTHER = 1e-6
# How far on the way from home a warm start is.
_WARM = 0.95
_SEED = 6
# Of the motion that is followed: two seconds at 1 kHz, forth and back.
_SPAN = 2001


def measure(plan: Plan, states: States, progress: Progress) -> dict[str, Any]:
    """Returns the entry `forward_kinematics` of the results."""
    progress("poses of the workspaces")
    rng = np.random.default_rng(_SEED)
    workspaces = [row for name in MECHANISMS for row in _workspace(Mechanism.load(name), plan.poses, rng)]
    lengths = _lengths(states.mechanism, plan.followed)
    return {
        "rows": _followed(plan, states, lengths, progress),
        "calls": _calls(plan, states, lengths[:_SPAN], rng, progress),
        "workspaces": workspaces,
    }


def _lengths(mechanism: Mechanism, samples: int) -> Array:
    """Returns (samples, 6) leg lengths each millisecond of the bundled motion, forth and back."""
    motion = bundled("sinusoids", mechanism, _SPAN)
    there = sixsps.compile(mechanism).inverse_kinematics(motion).lengths
    return np.resize(np.concatenate([there, there[-2:0:-1]]), (samples, 6))


def _followed(plan: Plan, states: States, lengths: Array, progress: Progress) -> list[dict[str, Any]]:
    models = {count: sixsps.compile(states.mechanism, count) for count in thread_counts()}
    contestants = [
        Contestant(on_threads(FOLLOWED, count), len(lengths), partial(model.forward_kinematics, lengths))
        for count, model in models.items()
    ]
    times = interleaved(contestants, plan.rounds, plan.turn, progress)
    return [
        {"name": one.name, "samples": len(lengths), "ns_per_sample": times[one.name]} for one in contestants
    ]


def _calls(
    plan: Plan, states: States, lengths: Array, rng: np.random.Generator, progress: Progress
) -> list[dict[str, Any]]:
    mechanism, model = states.mechanism, sixsps.compile(states.mechanism, 1)
    poses = sixsps.forward_kinematics(mechanism, lengths)
    guesses = [sixsps.Pose(p, q) for p, q in zip(poses.position, poses.quaternion, strict=True)]
    following = list(zip(lengths[1:], guesses, strict=False))
    position, rotation, _ = workspace_poses(mechanism, len(following), rng)
    anywhere = [(one,) for one in _lengths_at(mechanism, position, rotation)]
    callers = [
        Caller(NEXT, "compiled, from the pose a millisecond before", "", model.forward_kinematics, following),
        Caller(FROM_HOME, "compiled, anywhere in the workspace", "", model.forward_kinematics, anywhere),
        Caller(
            PLAIN, "from the pose a millisecond before", "", sixsps.forward_kinematics,
            [(mechanism, *one) for one in following],
        ),
    ]  # fmt: skip
    times: dict[str, list[Any]] = {one.name: [] for one in callers}
    for number in range(plan.rounds):
        progress(f"single calls, round {number + 1} of {plan.rounds}")
        with undisturbed():
            for one in callers:
                times[one.name].append(timed(one, -(-plan.calls["arrays"] // plan.rounds)))
    return [summary(one, times[one.name]) for one in callers]


def _workspace(mechanism: Mechanism, count: int, rng: np.random.Generator) -> Iterator[dict[str, Any]]:
    """Yields what became of random poses of a workspace, from each kind of guess."""
    position, rotation, share = workspace_poses(mechanism, count, rng)
    lengths = _lengths_at(mechanism, position, rotation)
    condition = _conditions(mechanism, position, rotation)
    home, vector = home_position(mechanism), Rotation.from_matrix(rotation).as_rotvec()
    turn = Rotation.from_rotvec(_WARM * vector).as_quat(scalar_first=True)
    guesses = {
        "home": (np.tile(home, (count, 1)), np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))),
        "the pose before": None,
        "a warm start": (home + _WARM * (position - home), turn),
    }
    for name, guess in guesses.items():
        found = sixsps.forward_kinematics(mechanism, lengths, guess, on_failure="return")
        along = np.linalg.norm(found.position - position, axis=1) / mechanism.characteristic_length
        about = np.linalg.norm(found.rotation - rotation, axis=(1, 2)) / np.sqrt(2)
        error = np.maximum(along, about)[found.ok]
        yield {
            "mechanism": mechanism.name, "guess": name, "poses": count, "share_of_drawn": share,
            "status": {status: int((found.status == status).sum()) for status in dict.fromkeys(STATUSES)},
            "others": int((error > _ANOTHER).sum()), "error": float(error.max()),
            "error_over_condition": float((error / condition[found.ok]).max() / _UNIT_ROUNDOFF),
            "condition": float(condition.max()),
            "residual": float(found.residual[found.ok].max() / mechanism.characteristic_length),
            "iterations": [float(np.median(found.iterations)), int(found.iterations.max())],
        }  # fmt: skip


def _lengths_at(mechanism: Mechanism, position: Array, rotation: Array) -> Array:
    arms = np.einsum("nij,kj->nki", rotation, mechanism.platform_anchors)
    return np.asarray(np.linalg.norm((position[:, None] - mechanism.base_anchors) + arms, axis=-1))


def _conditions(mechanism: Mechanism, position: Array, rotation: Array) -> Array:
    """Returns (n,) condition numbers of the Jacobian, angular columns over the characteristic length."""
    arms = np.einsum("nij,kj->nki", rotation, mechanism.platform_anchors)
    legs = (position[:, None] - mechanism.base_anchors) + arms
    directions = legs / np.linalg.norm(legs, axis=-1, keepdims=True)
    moments = np.cross(arms, directions) / mechanism.characteristic_length
    return np.asarray(np.linalg.cond(np.concatenate([directions, moments], axis=-1)))
