"""Analytic motions with exact derivatives, and the fitting of any motion to a mechanism.

scipy is imported where it is used: it would take most of the time of a short command.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from sixsps.arrays import Array
from sixsps.errors import MotionError, UnknownNameError
from sixsps.home import home_position
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.rotation import euler_motion

SAMPLES = 2001
# The paper's external force on the platform [N]; the bundled motions all carry it.
PAPER_FORCE = (80.0, -50.0, -100.0)
_MARGIN = 0.9
_MOST_ENLARGED = 10.0


def line(
    time: ArrayLike,
    start: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    force: ArrayLike = (0.0, 0.0, 0.0),
) -> Motion:
    """Returns a straight line at constant acceleration, orientation identity.

    Args:
        time: (n,) [s].
        start: (3,) position of O1 at time 0 [m].
        velocity: (3,) at time 0 [m/s].
        acceleration: (3,) constant [m/s^2].
        force: (3,) constant external force [N].
    """
    t = np.asarray(time, dtype=np.float64)[:, None]
    v, a = np.asarray(velocity, dtype=np.float64), np.asarray(acceleration, dtype=np.float64)
    position = np.asarray(start, dtype=np.float64) + v * t + a * t**2 / 2
    return _translation(t, position, v + a * t, np.broadcast_to(a, position.shape), force, "line")


def sinusoids(
    time: ArrayLike,
    center: ArrayLike,
    amplitude: ArrayLike,
    frequency: ArrayLike,
    phase: ArrayLike = (0.0,) * 6,
    force: ArrayLike = (0.0, 0.0, 0.0),
) -> Motion:
    """Returns sinusoids on x, y, z, alpha, beta, gamma with R = Rx(alpha) Ry(beta) Rz(gamma).

    Args:
        time: (n,) [s].
        center: (6,) mean position [m] and Euler angles [rad].
        amplitude: (6,) [m], [rad].
        frequency: (6,) [Hz].
        phase: (6,) at time 0 [rad].
        force: (3,) constant external force [N].
    """
    from scipy.spatial.transform import Rotation

    t = np.asarray(time, dtype=np.float64)[:, None]
    pulsation = 2 * np.pi * np.asarray(frequency, dtype=np.float64)
    size = np.asarray(amplitude, dtype=np.float64)
    angle = pulsation * t + np.asarray(phase, dtype=np.float64)
    q = np.asarray(center, dtype=np.float64) + size * np.sin(angle)
    dq = size * pulsation * np.cos(angle)
    ddq = -size * pulsation**2 * np.sin(angle)
    omega, epsilon = euler_motion(q[:, 3:], dq[:, 3:], ddq[:, 3:])
    return Motion(
        time=t[:, 0],
        position=q[:, :3],
        quaternion=Rotation.from_euler("XYZ", q[:, 3:]).as_quat(scalar_first=True),
        velocity=dq[:, :3],
        angular_velocity=omega,
        acceleration=ddq[:, :3],
        angular_acceleration=epsilon,
        force=np.broadcast_to(force, (len(t), 3)),
        name="sinusoids",
    )


def quintic(
    time: ArrayLike,
    start: ArrayLike,
    end: ArrayLike,
    rotation_vector: ArrayLike = (0.0, 0.0, 0.0),
    force: ArrayLike = (0.0, 0.0, 0.0),
) -> Motion:
    """Returns a rest-to-rest motion along 10 tau^3 - 15 tau^4 + 6 tau^5.

    Args:
        time: (n,) from departure to arrival [s].
        start: (3,) position at departure, orientation identity [m].
        end: (3,) position at arrival [m].
        rotation_vector: (3,) axis times angle of the orientation at arrival, world axes [rad].
        force: (3,) constant external force [N].
    """
    from scipy.spatial.transform import Rotation

    t = np.asarray(time, dtype=np.float64)
    duration = t[-1] - t[0]
    path = Polynomial([0, 0, 0, 10, -15, 6])
    tau = (t - t[0]) / duration
    s, ds, dds = (path.deriv(k)(tau)[:, None] / duration**k if k else path(tau)[:, None] for k in range(3))
    first = np.asarray(start, dtype=np.float64)
    way = np.asarray(end, dtype=np.float64) - first
    turn = np.asarray(rotation_vector, dtype=np.float64)
    return Motion(
        time=t,
        position=first + s * way,
        quaternion=Rotation.from_rotvec(s * turn).as_quat(scalar_first=True),
        velocity=ds * way,
        angular_velocity=ds * turn,
        acceleration=dds * way,
        angular_acceleration=dds * turn,
        force=np.broadcast_to(force, (len(t), 3)),
        name="quintic",
    )


def circle(
    time: ArrayLike,
    center: ArrayLike,
    radius: float,
    frequency: float,
    force: ArrayLike = (0.0, 0.0, 0.0),
) -> Motion:
    """Returns a horizontal circle at constant speed, orientation identity.

    Args:
        time: (n,) [s].
        center: (3,) [m].
        radius: [m].
        frequency: turns per second [Hz].
        force: (3,) constant external force [N].
    """
    return _spiral(time, center, (radius, 0.0), frequency, 0.0, force, "circle")


def spiral(
    time: ArrayLike,
    center: ArrayLike,
    radius: float,
    frequency: float,
    climb: float,
    force: ArrayLike = (0.0, 0.0, 0.0),
) -> Motion:
    """Returns a rising spiral whose radius grows evenly from 0, orientation identity.

    Args:
        time: (n,) from start to end [s].
        center: (3,) at the start [m].
        radius: at the end [m].
        frequency: turns per second [Hz].
        climb: height gained over the motion [m].
        force: (3,) constant external force [N].
    """
    t = np.asarray(time, dtype=np.float64)
    duration = t[-1] - t[0]
    growth = (-radius * t[0] / duration, radius / duration)
    return _spiral(t, center, growth, frequency, climb / duration, force, "spiral")


def _spiral(
    time: ArrayLike,
    center: ArrayLike,
    radius: tuple[float, float],
    frequency: float,
    climb_rate: float,
    force: ArrayLike,
    name: str,
) -> Motion:
    """Motion at radius[0] + radius[1] t, from the second derivative of r exp(i w t)."""
    t = np.asarray(time, dtype=np.float64)[:, None]
    w = 2 * np.pi * frequency
    r, dr = radius[0] + radius[1] * t, radius[1]
    turn = np.exp(1j * w * t)
    curve = [r * turn, (dr + 1j * w * r) * turn, (2j * w * dr - w**2 * r) * turn]
    rise = [climb_rate * (t - t[0]), np.full_like(t, climb_rate), np.zeros_like(t)]
    position, velocity, acceleration = (
        np.hstack([z.real, z.imag, h]) for z, h in zip(curve, rise, strict=True)
    )
    return _translation(t, np.asarray(center) + position, velocity, acceleration, force, name)


def _translation(
    t: Array, position: Array, velocity: Array, acceleration: Array, force: ArrayLike, name: str
) -> Motion:
    still = np.zeros_like(position)
    return Motion(
        time=t[:, 0],
        position=position,
        velocity=velocity,
        angular_velocity=still,
        acceleration=acceleration,
        angular_acceleration=still,
        force=np.broadcast_to(force, position.shape),
        name=name,
    )


def fitted(motion: Motion, mechanism: Mechanism) -> Motion:
    """Returns the motion shifted to the mechanism's home and its translation scaled to the strokes.

    The orientation stays as it is. The translation from the middle of its range is scaled, with its
    derivatives, so that by the triangle inequality no leg uses more than nine tenths of what the
    limits and the orientation leave it, but enlarged tenfold at most: less is noise.

    Args:
        motion: any motion, in particular a recorded one relative to some other frame.
        mechanism: what it shall move.

    Raises:
        MotionError: the orientation alone takes a leg beyond its limits.
    """
    home = home_position(mechanism)
    A, b = mechanism.base_anchors, mechanism.platform_anchors
    lengths = np.linalg.norm(home + b - A, axis=1)
    limits = mechanism.length_limits
    turned = np.linalg.norm(np.einsum("nij,kj->nki", motion.rotation, b) - b, axis=-1).max(axis=0)
    room = np.minimum(lengths - limits[:, 0], limits[:, 1] - lengths) - turned
    if room.min() <= 0:
        leg = int(room.argmin())
        found = f"moves platform joint {leg + 1} by up to {turned[leg]:.3g} m from home"
        raise MotionError("orientation", found, f"less than {room[leg] + turned[leg]:.3g} m")
    middle = (motion.position.min(axis=0) + motion.position.max(axis=0)) / 2
    reach = float(np.linalg.norm(motion.position - middle, axis=1).max())
    scale = min(_MARGIN * float(room.min()) / reach, _MOST_ENLARGED) if reach > 0 else 1.0
    change = (
        f"translation scaled by {scale:.6g} about {_shown(middle)} m, which was moved to the home position "
        f"{_shown(home)} m; orientation as given"
    )
    return replace(
        motion,
        position=home + scale * (motion.position - middle),
        velocity=scale * motion.velocity,
        acceleration=scale * motion.acceleration,
        changes=(*motion.changes, change),
    )


def _shown(vector: Array) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in vector + 0.0) + "]"


def bundled_motions() -> list[str]:
    """Returns the names that `bundled` knows."""
    return sorted(_BUNDLED)


def bundled(name: str, mechanism: Mechanism, samples: int = SAMPLES) -> Motion:
    """Returns a bundled motion, placed at the mechanism's home and sized to its stroke.

    `line` on a mechanism with the anchors of `wu2012` is the paper's own: from [0, 0.2, 0.45] m at
    [0, 0.1, 0] m/s with [0, 0.1, 0] m/s^2 for 2 s. All carry the paper's external force.

    Args:
        name: one of `bundled_motions()`.
        mechanism: what it shall move.
        samples: number of samples, >= 2.

    Raises:
        UnknownNameError: there is no such motion.
    """
    if name not in _BUNDLED:
        raise UnknownNameError("motion", name, ", ".join(bundled_motions()))
    if name == "line" and _is_the_papers(mechanism):
        return line(np.linspace(0, 2, samples), [0, 0.2, 0.45], [0, 0.1, 0], [0, 0.1, 0], PAPER_FORCE)
    stroke = float(np.diff(mechanism.length_limits).min())
    return _BUNDLED[name](home_position(mechanism), stroke, samples)


def _is_the_papers(mechanism: Mechanism) -> bool:
    """Whether the anchors are those of `wu2012`, for which the paper's line was planned."""
    paper = Mechanism.load("wu2012")
    return np.array_equal(mechanism.base_anchors, paper.base_anchors) and np.array_equal(
        mechanism.platform_anchors, paper.platform_anchors
    )


def _line(home: Array, stroke: float, samples: int) -> Motion:
    reach = 0.2 * stroke
    start = home - [0, reach, 0]
    return line(np.linspace(0, 2, samples), start, [0, reach / 2, 0], [0, reach / 2, 0], PAPER_FORCE)


def _sinusoids(home: Array, stroke: float, samples: int) -> Motion:
    amplitude = np.array([0.12, 0.1, 0.08, 0, 0, 0]) * stroke + [0, 0, 0, 0.15, 0.12, 0.2]
    frequency, phase = [0.5, 0.7, 1.1, 0.9, 0.6, 0.8], [0, 0.4, 0.8, 1.2, 1.6, 2.0]
    time = np.linspace(0, 2, samples)
    return sinusoids(time, [*home, 0, 0, 0], amplitude, frequency, phase, PAPER_FORCE)


def _quintic(home: Array, stroke: float, samples: int) -> Motion:
    end = home + stroke * np.array([0.15, -0.1, 0.15])
    return quintic(np.linspace(0, 1, samples), home, end, [0.1, -0.15, 0.25], PAPER_FORCE)


def _circle(home: Array, stroke: float, samples: int) -> Motion:
    return circle(np.linspace(0, 2, samples), home, 0.2 * stroke, 1.0, PAPER_FORCE)


def _rising_spiral(home: Array, stroke: float, samples: int) -> Motion:
    time = np.linspace(0, 3, samples)
    return spiral(time, home - [0, 0, 0.1 * stroke], 0.2 * stroke, 1.0, 0.2 * stroke, PAPER_FORCE)


_BUNDLED: dict[str, Callable[[Array, float, int], Motion]] = {
    "line": _line,
    "sinusoids": _sinusoids,
    "quintic": _quintic,
    "circle": _circle,
    "spiral": _rising_spiral,
}
