"""Leg forces as a linear function of inertial parameters, and what a motion identifies of them."""

import dataclasses

import numpy as np
import pytest
from cases import BUNDLED, random_mechanism, random_motion

import sixsps
from sixsps import symbolic
from sixsps.bodies import Leg, Link, Platform
from sixsps.kinematics import inverse_kinematics
from sixsps.mechanism import Mechanism
from sixsps.regressor import (
    INERTIAL_PARAMETERS,
    SHARED_LEG_PARAMETERS,
    inertial_parameters,
    regressor,
    wrench_forces,
)
from sixsps.trajectories import bundled

UNIT_ROUNDOFF = np.finfo(float).eps / 2
# Two evaluations of the same forces differ by this many cond(J) unit roundoffs at most; a sum over
# parameters was seen to reach 1.8.
FACTOR = 20


def forces_of(mechanism, motion):
    return regressor(mechanism, motion) @ inertial_parameters(mechanism) + wrench_forces(mechanism, motion)


def assert_linear(mechanism, motion, formulation="kane"):
    expected = sixsps.inverse_dynamics(mechanism, motion, formulation)
    error = np.abs(forces_of(mechanism, motion) - expected).max(axis=1)
    growth = inverse_kinematics(mechanism, motion).error_growth
    assert np.all(error <= FACTOR * UNIT_ROUNDOFF * growth * np.abs(expected).max(axis=1))


class TestForces:
    """regressor @ parameters + wrench_forces = forces, to rounding times cond(J)."""

    @pytest.mark.parametrize("name", ["line", "sinusoids", "quintic", "circle", "spiral"])
    def test_on_bundled_mechanisms(self, mechanism, name):
        assert_linear(mechanism, bundled(name, mechanism, 200))

    @pytest.mark.parametrize("formulation", ["kane", "virtual-work"])
    def test_on_100_random_mechanisms(self, formulation):
        for seed in range(100):
            mechanism = random_mechanism(seed)
            assert_linear(mechanism, random_motion(mechanism, seed, tilt=1.0), formulation)

    def test_of_the_symbolic_model(self):
        mechanism = random_mechanism(3)
        assert_linear(mechanism, random_motion(mechanism, 3), "lagrange")

    @pytest.mark.parametrize("distance", [1e-2, 1e-5, 1e-8])
    def test_near_a_singularity(self, wu2012, distance):
        motion = bundled("sinusoids", wu2012, 7)
        position = np.array(motion.position)
        position[:, 2] = distance
        flat = dataclasses.replace(motion, position=position, quaternion=np.tile([1.0, 0, 0, 0], (7, 1)))
        assert inverse_kinematics(wu2012, flat).condition.min() > 0.1 / distance
        assert_linear(wu2012, flat)

    def test_far_from_the_origin(self, wu2012):
        shift = np.array([3e3, -1e4, 2e3])
        motion = bundled("sinusoids", wu2012, 20)
        far = dataclasses.replace(wu2012, base_anchors=wu2012.base_anchors + shift)
        assert_linear(far, dataclasses.replace(motion, position=motion.position + shift))

    def test_with_shared_legs(self, mechanism):
        motion = bundled("sinusoids", mechanism, 50)
        forces = regressor(mechanism, motion, shared_legs=True) @ inertial_parameters(
            mechanism, shared_legs=True
        )
        expected = regressor(mechanism, motion) @ inertial_parameters(mechanism)
        np.testing.assert_allclose(forces, expected, rtol=0, atol=1e-13 * np.abs(expected).max())

    def test_singular_poses_are_nan_and_cost_no_other_sample(self, wu2012):
        motion = bundled("line", wu2012, 5)
        position = np.array(motion.position)
        position[2] = [0.01, 0.02, 0.0]
        position[3] = wu2012.base_anchors[0] - wu2012.platform_anchors[0]
        motion = dataclasses.replace(motion, position=position)
        for found in (regressor(wu2012, motion), wrench_forces(wu2012, motion)):
            assert np.isnan(found[2:4]).all()
            assert np.isfinite(np.delete(found, [2, 3], axis=0)).all()

    @pytest.mark.parametrize("shared", [False, True])
    def test_of_no_samples(self, wu2012, shared):
        motion = bundled("line", wu2012, 5)[:0]
        parameters = SHARED_LEG_PARAMETERS if shared else INERTIAL_PARAMETERS
        assert regressor(wu2012, motion, shared_legs=shared).shape == (0, 6, len(parameters))
        assert wrench_forces(wu2012, motion).shape == (0, 6)


class TestParameters:
    def test_are_named_in_order(self, wu2012):
        values = dict(zip(INERTIAL_PARAMETERS, inertial_parameters(wu2012), strict=True))
        assert len(values) == 46
        assert values["platform.mass"] == 1.0
        assert values["platform.inertia_at_o1.zz"] == 0.005
        assert values["legs.3.lower.mass"] == 0.5
        assert values["legs.5.upper.first_moment"] == 0.3 * 0.225
        assert values["legs.0.lower.inertia_at_joint"] == 0.0084875 + 0.5 * 0.225**2

    def test_of_shared_legs_are_those_of_each_leg(self, mechanism):
        values = dict(zip(INERTIAL_PARAMETERS, inertial_parameters(mechanism), strict=True))
        shared = inertial_parameters(mechanism, shared_legs=True)
        for name, value in zip(SHARED_LEG_PARAMETERS, shared, strict=True):
            for leg in range(6):
                assert values[name.replace("legs.", f"legs.{leg}.")] == value

    def test_of_different_legs_are_not_shared(self):
        with pytest.raises(sixsps.MechanismError, match="six legs of different inertia"):
            inertial_parameters(random_mechanism(0), shared_legs=True)

    def test_of_a_platform_of_point_masses_are_their_sums(self):
        rng = np.random.default_rng(5)
        mass, place = rng.uniform(1, 2, 8), rng.standard_normal((8, 3))
        com = mass @ place / mass.sum()
        off = place - com
        inertia = np.einsum("k,kij->ij", mass, np.sum(off**2, 1)[:, None, None] * np.eye(3) - outer(off))
        mechanism = dataclasses.replace(random_mechanism(1), platform=Platform(mass.sum(), com, inertia))
        about_o1 = np.einsum("k,kij->ij", mass, np.sum(place**2, 1)[:, None, None] * np.eye(3) - outer(place))
        entries = [about_o1[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        expected = [mass.sum(), *mass @ place, *entries]
        np.testing.assert_allclose(inertial_parameters(mechanism)[:10], expected, rtol=1e-13)

    def test_of_a_slender_rod_held_at_its_end(self):
        rod = Link.solid_cylinder(3.0, 2.0, 1e-6)
        mechanism = dataclasses.replace(random_mechanism(1), legs=(Leg(rod, rod),) * 6)
        np.testing.assert_allclose(
            inertial_parameters(mechanism, shared_legs=True)[10:13], [3.0, 3.0, 3.0 * 2.0**2 / 3], rtol=1e-9
        )


def outer(vectors):
    return vectors[:, :, None] * vectors[:, None, :]


def with_other_inertia(mechanism, com):
    other = random_mechanism(99)
    platform = Platform(other.platform.mass, com, other.platform.inertia)
    return dataclasses.replace(mechanism, platform=platform, legs=other.legs)


def test_regressor_reads_neither_inertia_nor_the_wrench():
    mechanism = random_mechanism(2)
    motion = random_motion(mechanism, 2)
    other = with_other_inertia(mechanism, com=[0.3, -0.2, 0.1])
    unloaded = dataclasses.replace(motion, force=None, moment=None)
    assert np.array_equal(regressor(mechanism, motion), regressor(other, unloaded))


def test_wrench_forces_read_the_point_of_the_load_and_no_inertia():
    mechanism = random_mechanism(2)
    motion = random_motion(mechanism, 2)
    other = with_other_inertia(mechanism, com=mechanism.platform.com)
    assert np.array_equal(wrench_forces(mechanism, motion), wrench_forces(other, motion))
    moved = with_other_inertia(mechanism, com=mechanism.platform.com + [0.1, 0, 0])
    assert not np.allclose(wrench_forces(mechanism, motion), wrench_forces(moved, motion))


@pytest.mark.parametrize("seed", range(10))
def test_wrench_forces_are_what_the_wrench_changes(seed):
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed)
    unloaded = dataclasses.replace(motion, force=None, moment=None)
    loaded = sixsps.inverse_dynamics(mechanism, motion)
    without = sixsps.inverse_dynamics(mechanism, unloaded)
    error = np.abs(wrench_forces(mechanism, motion) - (loaded - without)).max(axis=1)
    scale = (np.abs(loaded) + np.abs(without)).max(axis=1)
    growth = inverse_kinematics(mechanism, motion).error_growth
    assert np.all(error <= FACTOR * UNIT_ROUNDOFF * growth * scale)


@pytest.mark.parametrize("seed", range(5))
def test_columns_are_the_derivatives_of_the_symbolic_model(seed):
    """By the chain rule through the parameters, which CasADi has as masses, com and central inertia."""
    mechanism = random_mechanism(seed)
    motion = dataclasses.replace(random_motion(mechanism, seed), force=None, moment=None)
    exact = symbolic.evaluate(symbolic.parameter_derivatives(), mechanism, motion)["by_parameters"]
    matrices = regressor(mechanism, motion)
    growth = inverse_kinematics(mechanism, motion).error_growth[:, None]
    for name, changed in variations(mechanism):
        expected = exact[..., symbolic.PARAMETERS.index(name)]
        found = matrices @ changed
        scale = (np.abs(matrices) @ np.abs(changed)).max(axis=1, keepdims=True)
        assert np.all(np.abs(found - expected) <= FACTOR * UNIT_ROUNDOFF * growth * scale), name


def variations(mechanism):
    """Derivatives of the inertial parameters by the fields of platform and links, in closed form."""
    place = {name: index for index, name in enumerate(INERTIAL_PARAMETERS)}
    m, r = mechanism.platform.mass, mechanism.platform.com
    entries = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
    first = {f"platform.first_moment.{axis}": r[i] for i, axis in enumerate("xyz")}
    steiner = r @ r * np.eye(3) - np.outer(r, r)
    second = {f"platform.inertia_at_o1.{name}": steiner[at] for name, at in entries.items()}
    changes = {"platform.mass": {"platform.mass": 1.0} | first | second}
    for i, axis in enumerate("xyz"):
        d = np.eye(3)[i]
        slope = 2 * r[i] * np.eye(3) - np.outer(d, r) - np.outer(r, d)
        second = {f"platform.inertia_at_o1.{name}": m * slope[at] for name, at in entries.items()}
        changes[f"platform.com.{axis}"] = {f"platform.first_moment.{axis}": m} | second
    for name in entries:
        changes[f"platform.inertia.{name}"] = {f"platform.inertia_at_o1.{name}": 1.0}
    for k, leg in enumerate(mechanism.legs):
        for half, link in (("lower", leg.lower), ("upper", leg.upper)):
            own = f"legs.{k}.{half}"
            mass, moment, inertia = (
                f"{own}.{field}" for field in ("mass", "first_moment", "inertia_at_joint")
            )
            changes[f"{own}.mass"] = {mass: 1.0, moment: link.com, inertia: link.com**2}
            changes[f"{own}.com"] = {moment: link.mass, inertia: 2 * link.mass * link.com}
            changes[f"{own}.transverse"] = {inertia: 1.0}
    for name, parts in changes.items():
        vector = np.zeros(len(INERTIAL_PARAMETERS))
        vector[[place[part] for part in parts]] = list(parts.values())
        yield name, vector


def test_bundled_mechanisms_have_legs_that_share_their_parameters():
    for name in BUNDLED:
        assert inertial_parameters(Mechanism.load(name), shared_legs=True).shape == (16,)
