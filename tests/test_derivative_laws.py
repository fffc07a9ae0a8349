"""Laws that the derivatives of the leg forces obey, whatever the mechanism and the state."""

import dataclasses

import numpy as np
from cases import random_mechanism, random_motion
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import sixsps
from sixsps.kinematics import inverse_kinematics
from sixsps.parameters import PARAMETERS, parameter_vector
from sixsps.rotation import skew

UNIT_ROUNDOFF = np.finfo(float).eps / 2
# Unit roundoffs times `error_growth` by which a law may be missed, relative to its largest term.
FACTOR = 100
BLOCKS = ("by_pose", "by_twist", "by_acceleration", "by_wrench")
seeds = st.integers(0, 10_000)


class Case:
    """A mechanism in a few states, with all derivatives of its forces."""

    def __init__(self, mechanism, motion):
        self.mechanism, self.motion = mechanism, motion
        model = sixsps.compile(mechanism, threads=1)
        self.slopes = model.inverse_dynamics_derivatives(motion)
        self.forces = self.slopes.forces
        self.by_parameters = model.parameter_derivatives(motion)
        self.J, _ = model.equations(motion)
        self.growth = inverse_kinematics(mechanism, motion).error_growth

    @classmethod
    def drawn(cls, seed):
        mechanism = random_mechanism(seed % 40)
        return cls(mechanism, random_motion(mechanism, seed, samples=3))

    def with_motion(self, **changes):
        return Case(self.mechanism, dataclasses.replace(self.motion, **changes))

    def by(self, prefix, suffix=""):
        """Derivatives (n, 6, k) by the parameters whose names begin and end like this, and their values."""
        places = [
            place
            for place, name in enumerate(PARAMETERS)
            if name.startswith(prefix) and name.endswith(suffix)
        ]
        return self.by_parameters[..., places], parameter_vector(self.mechanism)[places]

    def change(self, block, linear, angular):
        """Change of the forces (n, 6) with one block of the motion, to first order."""
        step = np.concatenate(np.broadcast_arrays(linear, angular), axis=-1)
        return np.einsum(
            "nij,nj->ni", getattr(self.slopes, block), np.broadcast_to(step, (len(self.motion), 6))
        )

    def assert_sum_vanishes(self, *terms):
        size = np.max([np.abs(term).max(axis=1) for term in terms], axis=0)
        assert np.all(np.abs(sum(terms)).max(axis=1) <= FACTOR * UNIT_ROUNDOFF * self.growth * size)

    def assert_equal(self, found, expected):
        """Arrays (n, ...) that are the same but for rounding."""
        axes = tuple(range(1, found.ndim))
        size = np.abs(expected).max(axis=axes)
        errors = np.abs(found - expected).max(axis=axes)
        assert np.all(errors <= FACTOR * UNIT_ROUNDOFF * self.growth * size)


def zeros(case):
    return np.zeros((len(case.motion), 3))


@given(seed=seeds)
def test_forces_balance_the_external_wrench(seed):
    """J dF = -[df; dm + (R com) x df]: the block of moments is -J^-1."""
    case = Case.drawn(seed)
    lever = skew(case.motion.rotation @ case.mechanism.platform.com)
    expected = -np.tile(np.eye(6), (len(case.motion), 1, 1))
    expected[:, 3:, :3] = -lever
    inverse = np.linalg.inv(case.J)
    case.assert_equal(case.slopes.by_wrench[..., 3:], -inverse[..., 3:])
    case.assert_equal(case.slopes.by_wrench, inverse @ expected)


@given(seed=seeds)
def test_forces_accelerate_the_mass_matrix(seed):
    """J dF = M d[a; epsilon], symmetric: heavier where it is pushed to."""
    case = Case.drawn(seed)
    mass = sixsps.mass_matrix(case.mechanism, case.motion.position, case.motion.rotation)
    case.assert_equal(case.slopes.by_acceleration, np.linalg.solve(case.J, mass))
    product = case.J @ case.slopes.by_acceleration
    scale = np.repeat([1.0, 1 / case.mechanism.characteristic_length], 3)
    product *= scale[:, None] * scale
    case.assert_equal(product, product.swapaxes(1, 2))


@given(seed=seeds)
def test_forces_are_quadratic_in_the_twist(seed):
    """F(s v) = F(0) + s^2 Q: the slope is odd, vanishes at rest and is 2 Q along the twist itself."""
    case = Case.drawn(seed)
    velocity, omega = case.motion.velocity, case.motion.angular_velocity
    back = case.with_motion(velocity=-velocity, angular_velocity=-omega)
    rest = case.with_motion(velocity=zeros(case), angular_velocity=zeros(case))
    np.testing.assert_array_equal(back.slopes.by_twist, -case.slopes.by_twist)
    np.testing.assert_array_equal(rest.slopes.by_twist, 0)
    case.assert_sum_vanishes(case.change("by_twist", velocity, omega) / 2, rest.forces, -case.forces)


@given(seed=seeds)
def test_forces_are_linear_in_acceleration_and_wrench(seed):
    case = Case.drawn(seed)
    for block, names in (
        ("by_acceleration", ("acceleration", "angular_acceleration")),
        ("by_wrench", ("force", "moment")),
    ):
        without = case.with_motion(**dict.fromkeys(names, zeros(case)))
        given = (getattr(case.motion, name) for name in names)
        case.assert_sum_vanishes(case.change(block, *given), without.forces, -case.forces)
        for each in ("by_twist", "by_acceleration", "by_wrench"):
            case.assert_equal(getattr(without.slopes, each), getattr(case.slopes, each))


@given(seed=seeds)
def test_derivatives_turn_with_the_world(seed):
    case, rng = Case.drawn(seed), np.random.default_rng(seed)
    R, shift = Rotation.random(rng=rng), rng.standard_normal(3) * case.mechanism.characteristic_length
    turn = R.as_matrix()
    names = ("velocity", "angular_velocity", "acceleration", "angular_acceleration", "force", "moment")
    moved = Case(
        dataclasses.replace(
            case.mechanism,
            gravity=turn @ case.mechanism.gravity,
            base_anchors=case.mechanism.base_anchors @ turn.T + shift,
        ),
        dataclasses.replace(
            case.motion,
            position=case.motion.position @ turn.T + shift,
            quaternion=(R * Rotation.from_matrix(case.motion.rotation)).as_quat(scalar_first=True),
            **{name: getattr(case.motion, name) @ turn.T for name in names},
        ),
    )
    both = np.kron(np.eye(2), turn)
    moved.assert_equal(moved.forces, case.forces)
    for block in BLOCKS:
        moved.assert_equal(getattr(moved.slopes, block) @ both, getattr(case.slopes, block))


@given(seed=seeds)
def test_legs_can_be_numbered_in_any_order(seed):
    case = Case.drawn(seed)
    order = np.random.default_rng(seed).permutation(6)
    mechanism = case.mechanism
    other = Case(
        dataclasses.replace(
            mechanism,
            base_anchors=mechanism.base_anchors[order],
            platform_anchors=mechanism.platform_anchors[order],
            legs=tuple(mechanism.legs[leg] for leg in order),
        ),
        case.motion,
    )
    for block in BLOCKS:
        case.assert_equal(getattr(other.slopes, block), getattr(case.slopes, block)[:, order])


@given(seed=seeds)
def test_moving_the_world_a_little_changes_nothing(seed):
    """Platform and base displaced together: by_pose against the derivatives by the base anchors."""
    case = Case.drawn(seed)
    base, _ = case.by("base.anchors")
    for axis in range(3):
        case.assert_sum_vanishes(
            case.change("by_pose", np.eye(3)[axis], np.zeros(3)), base[..., axis::3].sum(-1)
        )


@given(seed=seeds)
def test_turning_the_world_a_little_changes_nothing(seed):
    """All vectors, the gravity and the base turn about the world's origin: every block has its part."""
    case = Case.drawn(seed)
    motion = case.motion
    base, anchors = case.by("base.anchors")
    gravity, g = case.by("gravity")
    for e in np.eye(3):
        pairs = {
            "by_twist": (motion.velocity, motion.angular_velocity),
            "by_acceleration": (motion.acceleration, motion.angular_acceleration),
            "by_wrench": (motion.force, motion.moment),
        }
        terms = [case.change("by_pose", np.cross(e, motion.position), e)]
        terms += [
            case.change(block, *(np.cross(e, given) for given in pair)) for block, pair in pairs.items()
        ]
        terms.append(base @ np.cross(e, anchors.reshape(6, 3)).ravel())
        case.assert_sum_vanishes(*terms, gravity @ np.cross(e, g))


@given(seed=seeds)
def test_moving_the_platform_frame_a_little_changes_nothing(seed):
    """O1 shifted within the platform: anchors and centre of mass move back, the motion is that of new O1."""
    case = Case.drawn(seed)
    motion, none = case.motion, np.zeros(3)
    omega, epsilon = skew(motion.angular_velocity), skew(motion.angular_acceleration)
    (joints, _), (com, _) = case.by("platform.anchors"), case.by("platform.com")
    for axis in range(3):
        shift = motion.rotation[..., axis]
        velocity = times(omega, shift)
        case.assert_sum_vanishes(
            case.change("by_pose", shift, none),
            case.change("by_twist", velocity, none),
            case.change("by_acceleration", times(epsilon, shift) + times(omega, velocity), none),
            -joints[..., axis::3].sum(-1),
            -com[..., axis],
        )


@given(seed=seeds)
def test_turning_the_platform_frame_a_little_changes_nothing(seed):
    """The pose turns one way, anchors, centre of mass and inertia within the platform the other way."""
    case = Case.drawn(seed)
    joints, anchors = case.by("platform.anchors")
    com, r = case.by("platform.com")
    inertia, _ = case.by("platform.inertia")
    tensor = case.mechanism.platform.inertia
    for e in np.eye(3):
        turned = skew(e) @ tensor - tensor @ skew(e)
        entries = turned[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]  # xx yy zz xy xz yz
        case.assert_sum_vanishes(
            case.change("by_pose", np.zeros(3), -case.motion.rotation @ e),
            joints @ np.cross(e, anchors.reshape(6, 3)).ravel(),
            com @ np.cross(e, r),
            inertia @ entries,
        )


def weighted(case, prefix, suffix=""):
    """Change of the forces (n, 6) when some parameters grow in proportion."""
    slopes, values = case.by(prefix, suffix)
    return slopes @ values


def lengths(case):
    """Change of the forces when all lengths of the mechanism, and gravity, grow in proportion."""
    return [weighted(case, "base."), weighted(case, "platform.anchors"), weighted(case, "platform.com"),
            weighted(case, "legs.", ".com"), weighted(case, "gravity")]  # fmt: skip


def inertias(case):
    return [weighted(case, "platform.inertia"), weighted(case, "legs.", ".transverse")]


@given(seed=seeds)
def test_forces_scale_with_masses_and_loads(seed):
    """Euler's theorem: F is of degree one in everything that is measured in kilograms."""
    case = Case.drawn(seed)
    case.assert_sum_vanishes(
        weighted(case, "platform.mass"),
        weighted(case, "legs.", ".mass"),
        *inertias(case),
        case.change("by_wrench", case.motion.force, case.motion.moment),
        -case.forces,
    )


@given(seed=seeds)
def test_forces_scale_with_lengths(seed):
    """F is of degree one in lengths, where velocities and loads follow; inertias and moments square."""
    case = Case.drawn(seed)
    motion, none = case.motion, np.zeros(3)
    case.assert_sum_vanishes(
        *lengths(case),
        *(2 * term for term in inertias(case)),
        case.change("by_pose", motion.position, none),
        case.change("by_twist", motion.velocity, none),
        case.change("by_acceleration", motion.acceleration, none),
        case.change("by_wrench", motion.force, 2 * motion.moment),
        -case.forces,
    )


@given(seed=seeds)
def test_forces_scale_with_time(seed):
    """F is of degree two in rates: twice as fast, four times the accelerations, gravity and loads."""
    case = Case.drawn(seed)
    motion = case.motion
    case.assert_sum_vanishes(
        case.change("by_twist", motion.velocity, motion.angular_velocity),
        2 * case.change("by_acceleration", motion.acceleration, motion.angular_acceleration),
        2 * case.change("by_wrench", motion.force, motion.moment),
        2 * weighted(case, "gravity"),
        -2 * case.forces,
    )


@given(seed=seeds)
def test_axial_inertia_has_no_part(seed):
    slopes, _ = Case.drawn(seed).by("legs.", ".axial")
    assert slopes.shape[-1] == 12
    np.testing.assert_array_equal(slopes, 0)


def times(matrices, vectors):
    return np.einsum("nij,nj->ni", matrices, vectors)
