"""Pinocchio's forward dynamics: what the contract of all engines does not ask."""

import numpy as np
import pytest
from cases import random_mechanism, random_motion
from test_forward_engines import load, scales, state
from test_forward_mujoco import assert_on_the_way_of_the_closed_form, integrated

import sixsps
from sixsps.dynamics import mass_matrix
from sixsps.trajectories import bundled

NOTHING = np.zeros(6), np.zeros(3), np.zeros(3)


class TestPinocchio:
    @pytest.fixture
    def make(self):
        return load("pinocchio")

    def test_projected_mass_matrix_is_that_of_the_platform(self, make, mechanism):
        assert_projected(make, mechanism, bundled("sinusoids", mechanism, 10))

    def test_projected_mass_matrix_of_random_mechanisms(self, make):
        for seed in range(50):
            mechanism = random_mechanism(seed)
            assert_projected(make, mechanism, random_motion(mechanism, seed, samples=2))

    def test_integrated_goes_the_way_of_the_closed_form(self, make, wu2012):
        """30 velocities and 18 closures whose gaps nothing draws shut."""
        engine = make(wu2012)
        assert_on_the_way_of_the_closed_form(engine, integrated(engine, wu2012), wu2012, 1e-12)

    def test_closures_that_are_not_met_are_an_error(self, make, wu2012):
        """The proximal iterations stopped short: `absolute_residual` would be the library's own word."""
        import pinocchio as pin

        engine = make(wu2012)
        y = engine.initial(state(bundled("line", wu2012, 3)))
        engine._proximal = pin.ProximalSettings(1e-12, 1e-3, 1)
        with pytest.raises(sixsps.EngineError, match=r"^constraintDynamics left .* m/s\^2 between the ends"):
            engine.rates(y, *NOTHING)


def assert_projected(make, mechanism, motion):
    """N^T M N of the tree, with N from the platform's twist to all 30 velocities."""
    import pinocchio as pin

    from compare.engines.pinocchio import joint_rates

    engine = make(mechanism)
    tree, expected = engine.tree, mass_matrix(mechanism, motion.position, motion.rotation)
    for k in range(len(motion)):
        q = engine.initial(state(motion, k))[: tree.model.nq]
        to_joint = np.eye(6)
        to_joint[3:, 3:] = motion.rotation[k].T  # the ball turns about axes of the platform
        N = np.column_stack([joint_rates(tree, q, rate, np.zeros(6))[0] for rate in to_joint.T])
        tree_matrix = pin.crba(tree.model, tree.data, q)
        tree_matrix = np.triu(tree_matrix) + np.triu(tree_matrix, 1).T
        error = (N.T @ tree_matrix @ N - expected[k]) / scales(mechanism) / scales(mechanism)[:, None]
        size = np.abs(expected[k] / scales(mechanism) / scales(mechanism)[:, None]).max()
        assert np.abs(error).max() <= 1e-11 * size
