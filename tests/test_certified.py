"""The certified forces against a computation in 60 digits that goes another way."""

import dataclasses

import mpmath as mp
import numpy as np
import pytest
from cases import at_rest, random_mechanism, random_motion

import sixsps
from sixsps.trajectories import bundled

certified = pytest.importorskip("sixsps.certified", reason="needs python-flint", exc_type=ImportError)

UNIT_ROUNDOFF = np.finfo(float).eps / 2


def column(values):
    return mp.matrix([mp.mpf(float(value)) for value in values])


def cross(a, b):
    return mp.matrix([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def dot(a, b):
    return (a.T * b)[0]


def skew(a):
    return mp.matrix([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def rotation(quaternion):
    w, x, y, z = column(quaternion) / mp.norm(column(quaternion))
    v = mp.matrix([x, y, z])
    return mp.eye(3) + 2 * w * skew(v) + 2 * skew(v) * skew(v)


def kane_in_60_digits(mechanism, motion, k):
    """Leg forces by the equations of design section 4: velocities and partial velocities, no series."""
    P, v, w = (column(getattr(motion, n)[k]) for n in ("position", "velocity", "angular_velocity"))
    a, eps = column(motion.acceleration[k]), column(motion.angular_acceleration[k])
    R, g, E = rotation(motion.quaternion[k]), column(mechanism.gravity), mp.eye(3)
    J, C = mp.zeros(6, 6), mp.zeros(6, 1)
    for i, leg in enumerate(mechanism.legs):
        c = R * column(mechanism.platform_anchors[i])
        S = P + c - column(mechanism.base_anchors[i])
        dS, ddS = v + cross(w, c), a + cross(eps, c) + cross(w, cross(w, c))
        length = mp.norm(S)
        s = S / length
        w_l = cross(s, dS) / length
        eps_l = (cross(s, ddS) - 2 * dot(s, dS) * w_l) / length
        dds = cross(eps_l, s) - dot(w_l, w_l) * s
        K = dot(s, c) * E - c * s.T
        across, moment = E - s * s.T, cross(c, s)
        for link in (leg.lower, leg.upper):
            e = mp.mpf(link.com)
            if link is leg.lower:
                linear, angular = e / length * across, -e / length * skew(s) * K
                acceleration = e * dds
            else:
                rest = 1 - e / length
                linear, angular = s * s.T + rest * across, s * moment.T - rest * skew(s) * K
                acceleration = ddS - e * dds
            force = mp.mpf(link.mass) * (acceleration - g)
            torque = mp.mpf(link.transverse) * eps_l
            C[:3, 0] += linear.T * force + (skew(s) / length).T * torque
            C[3:, 0] += angular.T * force + (K / length).T * torque
        J[:3, i], J[3:, i] = s, moment
    r = R * column(mechanism.platform.com)
    a_m = a + cross(eps, r) + cross(w, cross(w, r))
    inertia = R * mp.matrix(mechanism.platform.inertia.tolist()) * R.T
    force = mp.mpf(mechanism.platform.mass) * (a_m - g) - column(motion.force[k])
    C[:3, 0] += force
    C[3:, 0] += cross(r, force) + inertia * eps + cross(w, inertia * w) - column(motion.moment[k])
    return mp.lu_solve(J, C)


@pytest.mark.parametrize("seed", range(20))
def test_enclosures_contain_the_value_of_60_digits_and_keep_their_promise(seed):
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed)
    found = certified.certified_inverse_dynamics(mechanism, motion)
    with mp.workdps(60):
        for k, row in enumerate(found.enclosures):
            expected = kane_in_60_digits(mechanism, motion, k)
            largest = max(abs(value) for value in expected)
            for ball, value in zip(row, expected, strict=True):
                parts = (ball.mid(), ball.rad())
                middle, radius = (mp.mpf(part.str(80, radius=False)) for part in parts)
                assert radius <= certified.RADIUS * largest
                # The radius, and the 50 digits that the other computation is good for.
                assert abs(middle - value) <= radius + largest * mp.mpf(10) ** -50


def test_float64_forces_are_the_nearest_to_the_enclosures(wu2012):
    motion = bundled("sinusoids", wu2012, 5)
    found = certified.certified_inverse_dynamics(wu2012, motion)
    errors = found.errors(found.forces)
    assert np.all(errors <= UNIT_ROUNDOFF * np.abs(found.forces) * (1 + 1e-12))


@pytest.mark.parametrize("formulation", ["kane", "casadi"])
def test_formulations_stay_within_their_bound_of_the_truth(formulation):
    for seed in range(20):
        mechanism = random_mechanism(seed)
        motion = random_motion(mechanism, seed)
        truth = certified.certified_inverse_dynamics(mechanism, motion)
        forces = sixsps.inverse_dynamics(mechanism, motion, formulation)
        error = truth.errors(forces).max(axis=1) / np.abs(truth.forces).max(axis=1)
        condition = sixsps.inverse_kinematics(mechanism, motion).condition
        assert np.all(error <= 20 * condition * UNIT_ROUNDOFF)


def test_errors_are_upper_bounds(wu2012):
    motion = bundled("line", wu2012, 2)
    found = certified.certified_inverse_dynamics(wu2012, motion)
    moved = found.forces + 0.25
    assert np.all(np.abs(found.errors(moved) - 0.25) <= 1e-12)
    assert np.all(found.errors(moved) >= 0.25 - np.abs(found.errors(found.forces)))


class TestSingularPoses:
    @pytest.mark.parametrize(
        "position", [[0.01, 0.02, 0.0], [0.0, 0.0, 0.0]], ids=["flat", "flat and centred"]
    )
    def test_are_proven_and_have_no_number(self, wu2012, position):
        found = certified.certified_inverse_dynamics(wu2012, at_rest(position))
        assert found.singular.tolist() == [True]
        assert np.isnan(found.forces).all()
        assert np.isnan(found.errors(np.zeros((1, 6)))).all()

    def test_one_among_regular_ones(self, wu2012):
        motion = bundled("line", wu2012, 3)
        position = np.array(motion.position)
        position[1] = [0.01, 0.02, 0.0]
        found = certified.certified_inverse_dynamics(wu2012, dataclasses.replace(motion, position=position))
        assert found.singular.tolist() == [False, True, False]

    @pytest.mark.parametrize("height", [1e-6, 1e-12, 1e-30])
    def test_next_to_one_forces_are_still_certified(self, wu2012, height):
        """No float64 solve has a digit left at 1e-30; the enclosure has twenty."""
        found = certified.certified_inverse_dynamics(wu2012, at_rest([0.01, 0.02, height]))
        assert found.singular.tolist() == [False]
        largest = np.abs(found.forces).max()
        assert largest > 1e-2 / height
        assert max(float(ball.rad()) for ball in found.enclosures[0]) <= certified.RADIUS * largest


def test_precision_of_the_caller_is_left_as_it_was(wu2012):
    from flint import ctx

    before = ctx.prec, ctx.cap
    certified.certified_inverse_dynamics(wu2012, bundled("line", wu2012, 2))
    assert (ctx.prec, ctx.cap) == before
