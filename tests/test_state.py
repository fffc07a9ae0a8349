"""States of the platform: shapes, single states, quaternions of any length, singular poses."""

import dataclasses

import numpy as np
import pytest
from cases import at_rest, random_motion
from test_dynamics import assert_same_wrench, load_wrench

import sixsps
from sixsps.dynamics import (
    State,
    bias,
    forward_dynamics,
    kinetic_energy,
    mass_matrix,
    potential_energy,
)
from sixsps.kinematics import inverse_kinematics
from sixsps.trajectories import bundled


class TestState:
    def test_of_a_motion(self, wu2012):
        motion = bundled("sinusoids", wu2012, 7)
        state = State.of(motion)
        assert len(state) == 7
        for name in ("position", "quaternion", "velocity", "angular_velocity"):
            assert np.array_equal(getattr(state, name), getattr(motion, name))
        assert np.array_equal(state.rotation, motion.rotation)

    @pytest.mark.parametrize("n", [0, 1, 4])
    def test_shapes(self, wu2012, n):
        motion = bundled("sinusoids", wu2012, 5)[:n]
        state = State.of(motion)
        assert state.rotation.shape == (n, 3, 3)
        assert mass_matrix(wu2012, state.position, state.rotation).shape == (n, 6, 6)
        assert bias(wu2012, state).shape == (n, 6)
        forces = np.zeros((n, 6))
        assert forward_dynamics(wu2012, state, forces, motion.force, motion.moment).shape == (n, 6)
        assert kinetic_energy(wu2012, state).shape == (n,)
        assert potential_energy(wu2012, state.position, state.rotation).shape == (n,)

    def test_one_state_gives_what_it_gives_among_others(self, mechanism):
        motion = random_motion(mechanism, 4, samples=20)
        forces = sixsps.inverse_dynamics(mechanism, motion)
        whole = forward_dynamics(mechanism, State.of(motion), forces, motion.force, motion.moment)
        one = motion[7:8]
        single = forward_dynamics(mechanism, State.of(one), forces[7:8], one.force, one.moment)
        np.testing.assert_allclose(single[0], whole[7], rtol=1e-12, atol=1e-12 * np.abs(whole[7]).max())

    @pytest.mark.parametrize("length", [-1.0, -3.7, 1e-3, 1e6])
    def test_quaternions_may_have_any_length(self, mechanism, length):
        motion = random_motion(mechanism, 4)
        unit = State.of(motion)
        stretched = dataclasses.replace(unit, quaternion=length * unit.quaternion)
        np.testing.assert_allclose(stretched.rotation, unit.rotation, atol=1e-15)
        forces = sixsps.inverse_dynamics(mechanism, motion)
        found, expected = (
            forward_dynamics(mechanism, state, forces, motion.force, motion.moment)
            for state in (stretched, unit)
        )
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-11 * np.abs(expected).max())
        assert_same_wrench(mechanism, bias(mechanism, stretched), bias(mechanism, unit))
        np.testing.assert_allclose(
            kinetic_energy(mechanism, stretched), kinetic_energy(mechanism, unit), rtol=1e-12
        )

    @pytest.mark.parametrize("leg", range(6))
    def test_a_leg_of_no_length_gives_nan_and_costs_no_other_state(self, wu2012, leg):
        """Where rounding leaves 1e-17 m of the length, too."""
        motion = random_motion(wu2012, 4)
        position, quaternion = np.array(motion.position), np.array(motion.quaternion)
        position[2] = wu2012.base_anchors[leg] - wu2012.platform_anchors[leg]
        quaternion[2] = [1, 0, 0, 0]
        motion = dataclasses.replace(motion, position=position, quaternion=quaternion)
        state = State.of(motion)
        for found in (
            mass_matrix(wu2012, state.position, state.rotation),
            bias(wu2012, state),
            forward_dynamics(wu2012, state, np.ones((5, 6)), motion.force, motion.moment),
            kinetic_energy(wu2012, state),
            potential_energy(wu2012, state.position, state.rotation),
        ):
            assert np.isnan(found[2]).all()
            assert np.isfinite(np.delete(found, 2, axis=0)).all()

    def test_forces_have_accelerations_at_singular_poses(self, wu2012):
        flat = at_rest([0.01, 0.02, 0.0], force=[1.0, 2.0, 3.0])
        assert np.isnan(sixsps.inverse_dynamics(wu2012, flat)).all()
        found = forward_dynamics(wu2012, State.of(flat), np.ones((1, 6)), flat.force, flat.moment)
        M = mass_matrix(wu2012, flat.position, flat.rotation)[0]
        pushed = inverse_kinematics(wu2012, flat).jacobian[0].T @ np.ones(6) + load_wrench(wu2012, flat)[0]
        balance = M @ found[0] + bias(wu2012, State.of(flat))[0]
        np.testing.assert_allclose(balance, pushed, atol=1e-12 * np.abs(pushed).max())
