"""Mechanisms and motions that tests draw from."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from sixsps.bodies import Leg, Link, Platform
from sixsps.home import home_position
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.trajectories import sinusoids

BUNDLED = ("wu2012", "tsai2000", "taghirad2013")
RECORDED = Path(__file__).parents[2] / "shared" / "data" / "recorded_motion.csv"
DERIVATIVES = ("velocity", "angular_velocity", "acceleration", "angular_acceleration")
FIELDS = ("time", "position", "quaternion", *DERIVATIVES, "force", "moment")


def random_mechanism(seed):
    """Non-planar anchors, six different legs, off-centre mass, full inertia, tilted gravity."""
    rng = np.random.default_rng(seed)
    size = 10 ** rng.uniform(-1, 1)
    angles = np.sort(rng.uniform(0, 2 * np.pi, 6)) + rng.uniform(-0.2, 0.2, 6)
    base = _ring(rng, angles, size)
    platform = _ring(rng, angles + rng.uniform(0.3, 1.2) * (-1) ** np.arange(6), 0.6 * size)
    mass = 10 ** rng.uniform(-1, 3)
    turn = Rotation.random(rng=rng).as_matrix()
    gyration = np.sort(rng.uniform(0.1, 0.5, 3)) ** 2 * size**2
    gyration[2] = min(gyration[2], 0.99 * (gyration[0] + gyration[1]))
    inertia = mass * turn @ np.diag(gyration) @ turn.T
    inertia = (inertia + inertia.T) / 2
    return Mechanism(
        name=f"random {seed}",
        gravity=9.81 * Rotation.random(rng=rng).as_matrix()[0],
        base_anchors=base,
        platform_anchors=platform + rng.uniform(-0.2, 0.2, 3) * size,
        platform=Platform(mass, rng.uniform(-0.3, 0.3, 3) * size, inertia),
        legs=tuple(Leg(_link(rng, size, mass), _link(rng, size, mass)) for _ in range(6)),
    )


def _ring(rng, angles, radius):
    ring = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(6)])
    return radius * (ring + rng.uniform(-0.25, 0.25, (6, 3)))


def _link(rng, size, mass):
    length = size * rng.uniform(1, 1.6)
    weight = mass * 10 ** rng.uniform(-2, 0)
    transverse = weight * length**2 * rng.uniform(0.02, 0.2)
    return Link(weight, length, length * rng.uniform(0.2, 0.8), transverse, transverse * rng.uniform(0.01, 1))


def random_motion(mechanism, seed, samples=5, tilt=0.5):
    """Unrelated states around home: every pose, twist, acceleration and wrench is drawn anew."""
    rng = np.random.default_rng(seed)
    size = mechanism.characteristic_length
    rate = 10 ** rng.uniform(-1, 1)
    load = mechanism.platform.mass * 10

    def draw(scale):
        return scale * rng.standard_normal((samples, 3))

    return Motion(
        time=np.arange(samples),
        position=home_position(mechanism) + draw(0.2 * size),
        quaternion=Rotation.from_rotvec(draw(tilt)).as_quat(scalar_first=True),
        velocity=draw(rate * size),
        angular_velocity=draw(rate),
        acceleration=draw(rate**2 * size),
        angular_acceleration=draw(rate**2),
        force=draw(load),
        moment=draw(load * size),
        name="random states",
    )


def at_rest(position, quaternion=(1.0, 0.0, 0.0, 0.0), **given):
    """One sample at rest, or with the derivatives in `given`."""
    zero = np.zeros((1, 3))
    names = ("velocity", "angular_velocity", "acceleration", "angular_acceleration", "force", "moment")
    return Motion(
        time=[0.0],
        position=[position],
        quaternion=[quaternion],
        **{name: np.atleast_2d(given.get(name, zero)) for name in names},
    )


def still(n=4, **fields):
    """A motion that stays where it is, or with other columns where `fields` gives them."""
    zero = np.zeros((n, 3))
    return Motion(**{"time": np.arange(n), "position": zero, **dict.fromkeys(DERIVATIVES, zero)} | fields)


def times(samples=1000, rate=100.0, jitter=0.3, seed=0):
    """Sampling instants off an even grid by up to `jitter` of a step, from time 0."""
    rng = np.random.default_rng(seed)
    time = (np.arange(samples) + jitter * rng.uniform(-1, 1, samples)) / rate
    return time - time[0]


def wobble(time):
    """A motion below 1 Hz in all six directions, turning by up to half a radian about each axis."""
    center, amplitude = [0.1, -0.2, 0.5, 0.2, -0.3, 0.4], [0.1, 0.2, 0.05, 0.4, 0.3, 0.5]
    return sinusoids(time, center, amplitude, [0.3, 0.5, 0.7, 0.45, 0.35, 0.25], [0, 1, 2, 3, 4, 5])


def legs_within_limits(mechanism, motion):
    lengths = inverse_kinematics(mechanism, motion).lengths
    low, high = mechanism.length_limits.T
    return bool((lengths >= low).all() and (lengths <= high).all())


def scaled(mechanism, length, mass):
    """The same mechanism in other units of length and mass, gravity as it is."""

    def link(half):
        inertia = mass * length**2
        return Link(
            mass * half.mass, length * half.length, length * half.com,
            inertia * half.transverse, inertia * half.axial,
        )  # fmt: skip

    platform = mechanism.platform
    return replace(
        mechanism,
        base_anchors=length * mechanism.base_anchors,
        platform_anchors=length * mechanism.platform_anchors,
        platform=Platform(mass * platform.mass, length * platform.com, mass * length**2 * platform.inertia),
        legs=tuple(Leg(link(leg.lower), link(leg.upper)) for leg in mechanism.legs),
    )
