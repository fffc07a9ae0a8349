"""The paper as printed: every misprint by itself, and the table of errata."""

from pathlib import Path

import numpy as np
import pytest
from cases import random_mechanism, random_motion

import sixsps
from sixsps import errata
from sixsps.formulations.wu2012_printed import MISPRINTS, inverse_dynamics, with_euler_rates
from sixsps.kinematics import inverse_kinematics
from sixsps.rotation import euler_motion, euler_rates
from sixsps.trajectories import bundled

UNIT_ROUNDOFF = np.finfo(float).eps / 2
PAGE = Path(__file__).parents[1] / "docs" / "errata"


@pytest.mark.parametrize("seed", range(20))
def test_without_misprints_it_is_kane(seed):
    mechanism = random_mechanism(seed)
    motion = random_motion(mechanism, seed)
    expected = sixsps.inverse_dynamics(mechanism, motion)
    error = np.abs(inverse_dynamics(mechanism, motion, ()) - expected).max(axis=1)
    condition = inverse_kinematics(mechanism, motion).condition
    assert np.all(error <= 20 * UNIT_ROUNDOFF * condition * np.abs(expected).max(axis=1))


def test_every_misprint_costs_what_its_row_says():
    mechanism, motion = errata.case()
    expected = sixsps.inverse_dynamics(mechanism, motion)
    rows = {erratum.misprint: erratum.newtons for erratum in errata.errata()}
    for name, misprint in MISPRINTS.items():
        error = np.abs(inverse_dynamics(mechanism, motion, (name,)) - expected).max()
        assert rows[misprint] == pytest.approx(error, rel=1e-9)
        assert error > 1e-2
    together = np.abs(sixsps.inverse_dynamics(mechanism, motion, "wu2012-printed") - expected).max()
    assert errata.errata()[-1].newtons == pytest.approx(together, rel=1e-9)


def test_only_turning_and_loads_off_the_origin_bring_them_out(wu2012):
    """Along the paper's own line, of its platform without offset, two misprints make a difference."""
    motion = bundled("line", wu2012, 20)
    expected = sixsps.inverse_dynamics(wu2012, motion)
    largest = np.abs(expected).max()
    wrong = {
        name
        for name in MISPRINTS
        if np.abs(inverse_dynamics(wu2012, motion, (name,)) - expected).max() > 1e-12 * largest
    }
    assert wrong == {"sign", "rows"}


def test_leg_frames_that_spin_turn_no_symmetric_inertia():
    """Section 3: with Y square to the plane O A B the frame spins, the inertia it carries stays."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        anchor, tip = rng.standard_normal((2, 3))
        s = (tip - anchor) / np.linalg.norm(tip - anchor)
        y = np.cross(anchor, s)
        y /= np.linalg.norm(y)
        frame = np.column_stack([np.cross(y, s), y, s])
        turned = frame @ np.diag([3.0, 3.0, 0.5]) @ frame.T
        assert np.allclose(turned, 3.0 * np.eye(3) - 2.5 * np.outer(s, s), atol=1e-14)


def test_page_of_errata_is_what_the_command_writes(tmp_path):
    for path in errata.write(tmp_path):
        assert (PAGE / path.name).read_bytes() == path.read_bytes(), "run: sixsps errata --output docs/errata"


def test_euler_rates_undo_euler_motion():
    rng = np.random.default_rng(0)
    angles, rates, accelerations = rng.uniform(-1.2, 1.2, (3, 50, 3))
    found = euler_rates(angles, *euler_motion(angles, rates, accelerations))
    assert np.allclose(found[0], rates, rtol=0, atol=1e-13)
    assert np.allclose(found[1], accelerations, rtol=0, atol=1e-12)


def test_euler_rates_equal_angular_velocity_only_without_tilt(wu2012):
    line = bundled("line", wu2012, 5)
    assert np.array_equal(with_euler_rates(line).angular_velocity, line.angular_velocity)
    turning = bundled("sinusoids", wu2012, 50)
    assert np.abs(with_euler_rates(turning).angular_velocity - turning.angular_velocity).max() > 0.01
