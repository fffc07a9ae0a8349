"""Measures of agreement: pure functions of arrays."""

import numpy as np
import pytest

import sixsps
from compare import metrics
from sixsps.trajectories import bundled


class TestMetrics:
    def test_relative_error_is_of_the_largest_force(self):
        reference = np.array([[1.0, -100, 0, 0, 0, 0]])
        forces = reference + [[0, 0, 0.5, 0, 0, 0]]
        assert metrics.relative_error(forces, reference) == 0.005

    def test_nan_in_the_reference_does_not_count_and_does_not_hide(self):
        reference = np.array([[np.nan] * 6, [1.0] * 6])
        forces = np.array([[5.0] * 6, [1, 1, 1, 1, 1, 1.25]])
        worst = metrics.worst_difference(forces, reference)
        assert (worst.value, worst.sample, worst.leg) == (0.25, 1, 5)

    def test_no_forces_at_all(self):
        zero = np.zeros((2, 6))
        assert metrics.relative_error(zero, zero) == 0
        assert metrics.relative_error(zero + 1, zero) == 1

    def test_digits(self):
        assert metrics.digits(1e-10) == pytest.approx(10)
        assert metrics.digits(0.0) == metrics.MOST_DIGITS
        assert metrics.digits(3.0) == 0

    def test_violations_name_leg_sample_and_limit(self):
        lengths = np.full((3, 6), 1.0)
        lengths[1, 4] = 2.5
        lengths[2, 0] = 0.1
        found = metrics.limit_violations(lengths, np.tile([0.5, 2.0], (6, 1)))
        assert [(v.leg, v.worst_sample, v.limit) for v in found] == [(0, 2, 0.5), (4, 1, 2.0)]

    def test_power_balance_sees_a_wrong_force(self, wu2012):
        motion = bundled("line", wu2012, 5)
        legs = sixsps.inverse_kinematics(wu2012, motion)
        forces = sixsps.inverse_dynamics(wu2012, motion)
        from sixsps import symbolic

        rate = symbolic.evaluate(symbolic.energy_rate(), wu2012, motion)["rate"][:, 0]
        right = metrics.power_balance(wu2012, motion, legs, forces, rate)
        assert right.relative < 1e-14
        forces[2, 1] += 1.0
        wrong = metrics.power_balance(wu2012, motion, legs, forces, rate)
        assert wrong.watts == pytest.approx(abs(legs.length_rates[2, 1]), rel=1e-6)
