"""Base parameters, and their estimates from noisy forces."""

import dataclasses

import numpy as np
import pytest
from cases import at_rest, random_mechanism, random_motion
from scipy.spatial.transform import Rotation
from scipy.stats import binom
from test_regressor import forces_of, with_other_inertia

import sixsps
from sixsps.home import home_position
from sixsps.identification import base_parameters, identify
from sixsps.mechanism import Mechanism
from sixsps.regressor import (
    INERTIAL_PARAMETERS,
    inertial_parameters,
    regressor,
)
from sixsps.trajectories import bundled, quintic

KINDS = ("mass", "first_moment", "inertia")
LEG_NOISE = np.array([0.1, 0.2, 0.3, 0.5, 0.8, 1.0])


def rows_of(mechanism, motion, **options):
    return np.concatenate(regressor(mechanism, motion, **options))


class TestBaseParameters:
    """How many there are, and which."""

    @pytest.mark.parametrize("seed", range(10))
    def test_a_rich_motion_has_28_with_six_different_legs(self, seed):
        """Ten of the platform, which carries the upper links' masses at its joints, and three a leg."""
        mechanism = random_mechanism(seed)
        base = base_parameters(rows_of(mechanism, random_motion(mechanism, seed, samples=100)))
        assert len(base) == 28
        assert base.names[:10] == INERTIAL_PARAMETERS[:10]
        assert base.names[10:13] == (
            "legs.0.lower.first_moment", "legs.0.lower.inertia_at_joint", "legs.0.upper.first_moment"
        )  # fmt: skip
        assert base.unidentified == tuple(f"legs.{leg}.lower.mass" for leg in range(6))

    def test_a_rich_motion_has_28_on_bundled_mechanisms(self, mechanism):
        assert len(base_parameters(rows_of(mechanism, bundled("sinusoids", mechanism, 300)))) == 28

    @pytest.mark.parametrize("distance", [1e-5, 1e-8, 1e-10])
    def test_rounding_near_a_singularity_adds_none(self, wu2012, distance):
        motion = random_motion(wu2012, 3, samples=40)
        position = np.array(motion.position)
        position[:, 2] = distance * np.linspace(1, 2, 40)
        flat = dataclasses.replace(motion, position=position, quaternion=np.tile([1.0, 0, 0, 0], (40, 1)))
        assert len(base_parameters(rows_of(wu2012, flat))) == 28

    def test_shared_legs_leave_13(self, mechanism):
        motion = bundled("sinusoids", mechanism, 300)
        base = base_parameters(rows_of(mechanism, motion, shared_legs=True))
        assert len(base) == 13
        assert base.unidentified == ("legs.lower.mass",)

    def test_without_gravity_no_first_moment_of_a_lower_link_shows(self):
        mechanism = dataclasses.replace(random_mechanism(0), gravity=[0, 0, 0])
        base = base_parameters(rows_of(mechanism, random_motion(mechanism, 0, samples=100)))
        assert len(base) == 22
        hidden = [f"legs.{leg}.lower.{field}" for leg in range(6) for field in ("mass", "first_moment")]
        assert base.unidentified == tuple(hidden)

    @pytest.mark.parametrize(("name", "number"), [("line", 21), ("circle", 22), ("quintic", 25)])
    def test_poorer_motions_have_fewer(self, mechanism, name, number):
        """On the line a - g keeps its plane, on the circle not; the quintic turns about one axis."""
        base = base_parameters(rows_of(mechanism, bundled(name, mechanism, 300)))
        assert len(base) == number
        turns = name == "quintic"
        assert any("inertia_at_o1" in part for part in base.names) == turns
        assert any("inertia_at_o1" in part for part in base.unidentified) != turns

    def test_rest_shows_masses_and_first_moments_only(self):
        mechanism = random_mechanism(4)
        moving = random_motion(mechanism, 4, samples=100)
        zero = np.zeros((100, 3))
        still = dataclasses.replace(
            moving, velocity=zero, angular_velocity=zero, acceleration=zero, angular_acceleration=zero
        )
        base = base_parameters(rows_of(mechanism, still))
        # The upper links' moments and those of the lower ones tip a leg alike.
        assert len(base) == 4 + 6
        assert not any("inertia" in name for name in base.names)
        assert "legs.2.lower.first_moment - legs.2.upper.first_moment" in base.words()

    def test_nothing_shows_at_rest_without_gravity(self, wu2012):
        floating = dataclasses.replace(wu2012, gravity=[0, 0, 0])
        base = base_parameters(rows_of(floating, at_rest(home_position(wu2012))))
        assert len(base) == 0
        assert base.unidentified == INERTIAL_PARAMETERS

    @pytest.mark.parametrize("name", ["line", "circle", "quintic", "sinusoids", "about z"])
    def test_a_turned_world_changes_no_number(self, mechanism, name):
        """What was exactly 0 becomes rounding, and must not count."""
        home = home_position(mechanism)
        if name == "about z":
            motion = quintic(np.linspace(0, 1, 100), home, 1.1 * home, [0, 0, 0.4])
        else:
            motion = bundled(name, mechanism, 100)
        turn = Rotation.from_rotvec([0.7, -0.3, 1.1])

        def turned(vectors):
            return vectors @ turn.as_matrix().T

        there = dataclasses.replace(
            mechanism, gravity=turned(mechanism.gravity), base_anchors=turned(mechanism.base_anchors)
        )
        vectors = ("position", "velocity", "angular_velocity", "acceleration", "angular_acceleration")
        moved = dataclasses.replace(
            motion,
            quaternion=(turn * Rotation.from_matrix(motion.rotation)).as_quat(scalar_first=True),
            **{vector: turned(getattr(motion, vector)) for vector in vectors},
        )
        here, found = base_parameters(rows_of(mechanism, motion)), base_parameters(rows_of(there, moved))
        assert len(here) == len(found)
        assert here.unidentified == found.unidentified

    @pytest.mark.parametrize("name", ["line", "sinusoids"])
    @pytest.mark.parametrize("units", [(1e-3, 1.0, 1e-6), (1.0, 1e6, 1e3), (1e4, 1e4, 1e4)])
    def test_units_decide_nothing(self, wu2012, name, units):
        rows = rows_of(wu2012, bundled(name, wu2012, 100))
        kinds = [
            next(k for k, kind in enumerate(KINDS) if f".{kind}" in part) for part in INERTIAL_PARAMETERS
        ]
        factors = np.array(units)[kinds]
        here, there = base_parameters(rows), base_parameters(rows * factors)
        assert there.columns == here.columns
        assert there.condition == pytest.approx(here.condition, rel=1e-6)
        back = there.combinations * factors[list(there.columns), None] / factors
        np.testing.assert_allclose(back, here.combinations, rtol=1e-6, atol=1e-6)

    @pytest.mark.parametrize("name", ["line", "circle", "quintic", "sinusoids"])
    @pytest.mark.parametrize("shared", [False, True])
    def test_give_the_forces(self, mechanism, name, shared):
        motion = bundled(name, mechanism, 100)
        rows = rows_of(mechanism, motion, shared_legs=shared)
        base = base_parameters(rows)
        forces = rows @ inertial_parameters(mechanism, shared_legs=shared)
        found = rows[:, base.columns] @ base.combinations @ inertial_parameters(mechanism, shared_legs=shared)
        # Combinations lose what cond(J) and their own condition number let rounding grow to.
        bound = 1e-14 * base.condition
        np.testing.assert_allclose(found, forces, rtol=0, atol=bound * np.abs(forces).max())

    def test_are_the_upper_masses_at_the_platform_joints(self):
        """The combinations of a rich motion by hand, from where a mass may be moved unseen."""
        mechanism = random_mechanism(6)
        base = base_parameters(rows_of(mechanism, random_motion(mechanism, 6, samples=100)))
        expected = np.zeros((28, 46))
        expected[np.arange(28), base.columns] = 1
        for leg, b in enumerate(mechanism.platform_anchors):
            mass = INERTIAL_PARAMETERS.index(f"legs.{leg}.upper.mass")
            at_joint = b @ b * np.eye(3) - np.outer(b, b)
            moments = [at_joint[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
            expected[:10, mass] = [1, *b, *moments]
            lower = base.names.index(f"legs.{leg}.lower.inertia_at_joint")
            expected[lower, INERTIAL_PARAMETERS.index(f"legs.{leg}.upper.inertia_at_joint")] = 1
        np.testing.assert_allclose(base.combinations, expected, atol=1e-9)

    def test_in_words(self, wu2012):
        base = base_parameters(rows_of(wu2012, bundled("sinusoids", wu2012, 100), shared_legs=True))
        assert base.words()[0] == "platform.mass + 6 legs.upper.mass"
        assert base.words()[6] == "platform.inertia_at_o1.zz + 0.06 legs.upper.mass"
        assert base.words()[-1] == "legs.upper.first_moment"
        assert "legs.lower.inertia_at_joint + legs.upper.inertia_at_joint" in base.words()

    def test_singular_poses_and_other_shapes_are_refused(self, wu2012):
        flat = rows_of(wu2012, at_rest([0.01, 0.02, 0.0]))
        with pytest.raises(sixsps.InputError, match=r"rows\[0, 0\]: nan"):
            base_parameters(flat)
        with pytest.raises(sixsps.InputError, match=r"rows: shape \(5, 45\); allowed: shape \(n, 46\)"):
            base_parameters(np.ones((5, 45)))


def noisy(mechanism, motion, sigma, seed):
    return forces_of(mechanism, motion) + sigma * noise(motion, seed)


def noise(motion, seed):
    return np.random.default_rng(seed).standard_normal((len(motion), 6))


def estimates(mechanism, motion, seeds, shared=False):
    """Identifications of the same parameters from forces with noise of `LEG_NOISE`."""
    base = base_parameters(rows_of(mechanism, motion, shared_legs=shared))
    forces = forces_of(mechanism, motion)
    return [
        identify(mechanism, motion, forces + LEG_NOISE * noise(motion, seed), LEG_NOISE, base=base)
        for seed in range(seeds)
    ]


def truth(mechanism, base, shared=False):
    return base.combinations @ inertial_parameters(mechanism, shared_legs=shared)


class TestIdentification:
    @pytest.mark.parametrize("name", ["line", "circle", "quintic", "sinusoids"])
    @pytest.mark.parametrize("shared", [False, True])
    def test_forces_without_noise_give_the_parameters(self, mechanism, name, shared):
        motion = bundled(name, mechanism, 200)
        found = identify(mechanism, motion, forces_of(mechanism, motion), shared_legs=shared)
        expected = truth(mechanism, found.base, shared)
        error = np.abs(found.values - expected)
        assert np.all(error <= 1e-13 * found.base.condition * np.abs(expected).max())
        assert found.residual_std <= 1e-13 * np.abs(forces_of(mechanism, motion)).max()

    def test_reads_no_inertia(self):
        mechanism = random_mechanism(2)
        motion = random_motion(mechanism, 2, samples=40)
        other = with_other_inertia(mechanism, com=mechanism.platform.com)
        forces = noisy(mechanism, motion, 0.1, seed=0)
        assert np.array_equal(
            identify(mechanism, motion, forces).values, identify(other, motion, forces).values
        )

    @pytest.mark.parametrize(
        ("name", "samples", "seeds", "shared"),
        [("wu2012", 6, 800, False), ("wu2012", 20, 300, True), (6, 60, 300, False)],
    )
    def test_confidence_intervals_hold_the_truth_19_times_in_20(self, name, samples, seeds, shared):
        """Every parameter by itself; with 6 samples 8 degrees of freedom, where the normal
        distribution would give 91 %."""
        random = isinstance(name, int)
        mechanism = random_mechanism(name) if random else Mechanism.load(name)
        if random:
            motion = random_motion(mechanism, name, samples)
        else:
            motion = bundled("sinusoids", mechanism, samples)
        found = estimates(mechanism, motion, seeds, shared)
        low, high = np.moveaxis([each.intervals for each in found], 2, 0)
        expected = truth(mechanism, found[0].base, shared)
        hits = np.count_nonzero((low <= expected) & (expected <= high), axis=0)
        # One parameter in 100 000 may be outside by chance.
        least, most = binom.ppf([5e-6, 1 - 5e-6], seeds, 0.95)
        assert np.all((hits >= least) & (hits <= most))

    def test_covariance_is_that_of_many_estimates(self, wu2012):
        found = estimates(wu2012, bundled("sinusoids", wu2012, 30), 400)
        values = np.array([each.values for each in found])
        covariance = np.mean([each.covariance for each in found], axis=0)
        scale = np.sqrt(np.diag(covariance))
        scatter = np.cov((values / scale).T)
        # Sampling moves an entry by up to sqrt(2 / 400) = 0.07, and the largest of 784 by four times that.
        assert np.abs(scatter - covariance / np.outer(scale, scale)).max() <= 0.3
        bias = (values.mean(axis=0) - truth(wu2012, found[0].base)) / scale
        assert np.abs(bias).max() <= 4.5 / np.sqrt(400)
        # Mean of 400 variances, each off by sqrt(2 / 152).
        variance = np.mean([each.residual_std**2 for each in found])
        assert variance == pytest.approx(1, abs=4.5 * np.sqrt(2 / 152 / 400))
        np.testing.assert_allclose(
            found[0].standard_deviations ** 2, np.diag(found[0].covariance), rtol=1e-12
        )

    def test_noise_is_estimated_in_newtons_where_none_is_given(self, wu2012):
        motion = bundled("sinusoids", wu2012, 500)
        found = identify(wu2012, motion, noisy(wu2012, motion, 0.25, seed=1))
        assert found.residual_std == pytest.approx(0.25, rel=0.05)
        assert found.degrees_of_freedom == 3000 - 28
        assert found.residuals.std() == pytest.approx(found.residual_std, rel=0.01)

    def test_scale_of_sigma_does_not_matter_its_shape_may_differ(self, wu2012):
        motion = bundled("sinusoids", wu2012, 50)
        forces = noisy(wu2012, motion, LEG_NOISE, seed=1)
        by_leg = identify(wu2012, motion, forces, LEG_NOISE)
        by_sample = identify(wu2012, motion, forces, np.tile(1e3 * LEG_NOISE, (50, 1)))
        np.testing.assert_allclose(by_leg.values, by_sample.values, rtol=1e-9)
        np.testing.assert_allclose(by_leg.intervals, by_sample.intervals, rtol=1e-8)
        assert by_leg.residual_std == pytest.approx(1e3 * by_sample.residual_std)
        alike, without = identify(wu2012, motion, forces, 3.0), identify(wu2012, motion, forces)
        np.testing.assert_allclose(alike.values, without.values, rtol=1e-9)

    def test_knowing_the_noise_of_each_leg_makes_estimates_better(self, wu2012):
        motion = bundled("sinusoids", wu2012, 200)
        forces = noisy(wu2012, motion, [0.01, 1, 1, 1, 1, 1], seed=2)
        weighted = identify(wu2012, motion, forces, [0.01, 1, 1, 1, 1, 1])
        plain = identify(wu2012, motion, forces)
        first = weighted.base.names.index("legs.0.lower.first_moment")
        assert weighted.standard_deviations[first] < 0.5 * plain.standard_deviations[first]

    def test_shared_legs_are_known_better_than_six_different_ones(self, wu2012):
        motion = bundled("sinusoids", wu2012, 200)
        forces = noisy(wu2012, motion, 0.5, seed=3)
        shared = identify(wu2012, motion, forces, shared_legs=True)
        six = identify(wu2012, motion, forces)
        deviation = dict(zip(shared.base.names, shared.standard_deviations, strict=True))
        others = dict(zip(six.base.names, six.standard_deviations, strict=True))
        for field in ("lower.first_moment", "lower.inertia_at_joint", "upper.first_moment"):
            assert deviation[f"legs.{field}"] < min(others[f"legs.{leg}.{field}"] for leg in range(6))

    def test_legs_that_differ_do_not_fit_as_shared_ones(self):
        mechanism = random_mechanism(5)
        motion = random_motion(mechanism, 5, samples=100)
        forces = forces_of(mechanism, motion)
        wrong = identify(mechanism, motion, forces, shared_legs=True)
        assert wrong.residual_std > 1e-3 * np.abs(forces).max()

    def test_a_load_that_acts_elsewhere_is_given_by_its_point(self):
        """The com of the mechanism that is passed is where the force acts, whatever the true com is."""
        mechanism = random_mechanism(7)
        motion = random_motion(mechanism, 7, samples=60)
        point = np.array([0.3, -0.2, 0.1])
        arm = motion.rotation @ (point - mechanism.platform.com)
        on_com = dataclasses.replace(motion, moment=motion.moment + np.cross(arm, motion.force))
        loaded_there = with_other_inertia(mechanism, com=point)
        found = identify(loaded_there, motion, sixsps.inverse_dynamics(mechanism, on_com))
        expected = truth(mechanism, found.base)
        assert np.all(
            np.abs(found.values - expected) <= 1e-12 * found.base.condition * np.abs(expected).max()
        )

    def test_parameters_of_a_rich_motion_are_estimated_from_another(self, wu2012):
        base = base_parameters(rows_of(wu2012, bundled("sinusoids", wu2012, 100)))
        motion = random_motion(wu2012, 8, samples=50, tilt=0.3)
        found = identify(wu2012, motion, noisy(wu2012, motion, 1e-3, seed=0), base=base)
        assert found.base is base
        assert np.all(np.abs(found.values - truth(wu2012, base)) <= 5 * found.standard_deviations)


class TestErrors:
    @pytest.fixture
    def measured(self, wu2012):
        motion = bundled("sinusoids", wu2012, 20)
        return motion, forces_of(wu2012, motion)

    @pytest.mark.parametrize("shared", [False, True])
    def test_motion_too_poor_for_the_parameters_asked_for(self, wu2012, measured, shared):
        rich, _ = measured
        base = base_parameters(rows_of(wu2012, rich, shared_legs=shared))
        line = bundled("line", wu2012, 100)
        numbers = "6 of 13" if shared else "21 of 28"
        with pytest.raises(sixsps.MotionError, match=f"determines {numbers} base.*turns the platform"):
            identify(wu2012, line, forces_of(wu2012, line), base=base)

    def test_too_few_samples(self, wu2012, measured):
        motion, forces = measured
        with pytest.raises(sixsps.MotionError, match=r"24 forces for 24 base.*more forces than parameters"):
            identify(wu2012, motion[:4], forces[:4])
        with pytest.raises(sixsps.MotionError, match="0 forces for 0 base parameters"):
            identify(wu2012, motion[:0], forces[:0])

    def test_nothing_moves_and_nothing_weighs(self, wu2012):
        floating = dataclasses.replace(wu2012, gravity=[0, 0, 0])
        rest = at_rest(home_position(wu2012))
        with pytest.raises(sixsps.MotionError, match=r"6 forces for 0 base parameters; .* at least one"):
            identify(floating, rest, np.zeros((1, 6)))

    def test_singular_poses(self, wu2012, measured):
        motion, forces = measured
        position = np.array(motion.position)
        position[[3, 8], :] = [0.01, 0.02, 0.0]
        motion = dataclasses.replace(motion, position=position, quaternion=np.tile([1.0, 0, 0, 0], (20, 1)))
        with pytest.raises(sixsps.MotionError, match="2 samples at singular poses; allowed: regular poses"):
            identify(wu2012, motion, forces)

    @pytest.mark.parametrize(
        ("sigma", "message"),
        [
            (0.0, r"sigma: 0\.0; allowed: standard deviations > 0"),
            ([1, 1, 1, 1, 1, -1], r"sigma: -1\.0; allowed"),
            ([1, 2, 3], r"sigma: shape \(3,\); allowed: shape \(6\)"),
            (np.ones((20, 5)), r"sigma: shape \(20, 5\); allowed: shape \(20, 6\)"),
            (np.ones((1, 20, 6)), r"sigma: shape \(1, 20, 6\); allowed: shape \(20, 6\)"),
            (np.nan, "sigma: nan; allowed: finite"),
        ],
    )
    def test_standard_deviations_that_none_can_be(self, wu2012, measured, sigma, message):
        with pytest.raises(sixsps.InputError, match=message):
            identify(wu2012, *measured, sigma)

    def test_forces_that_none_can_be(self, wu2012, measured):
        motion, forces = measured
        with pytest.raises(sixsps.InputError, match=r"measured_forces: shape \(20, 5\)"):
            identify(wu2012, motion, forces[:, :5])
        forces[3, 2] = np.nan
        with pytest.raises(sixsps.InputError, match=r"measured_forces\[3, 2\]: nan"):
            identify(wu2012, motion, forces)
