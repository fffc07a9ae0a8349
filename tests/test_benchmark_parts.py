"""What the benchmarks compute is right: the graph in NumPy, the loops of the machine's peaks, the slopes."""

import platform
import re
from fractions import Fraction

import llvmlite.binding
import numpy as np
import pytest
from cases import random_mechanism, random_motion
from scipy.spatial.transform import Rotation

import sixsps
from benchmarks import arithmetic, slopes
from benchmarks.bandwidth import SCALE, Triad
from benchmarks.vectorised import VectorisedGraph, buffer_places
from benchmarks.workers import Workers
from sixsps.kernels.graph import graph
from sixsps.kernels.signatures import SIGNATURES
from sixsps.kinematics import inverse_kinematics

ROUNDOFF = 2.0**-53


def assert_close(given, expected, mechanism, motion):
    """Two orders of the same operations: each loses cond(J) roundings at each of three solves at most.

    Derivatives solve with J twice more than forces do; entries far below the largest of an output carry
    the rounding of those that they are the difference of.
    """
    if len(motion) == 0:
        return
    condition = inverse_kinematics(mechanism, motion).condition.max()
    assert np.abs(given - expected).max() <= 100 * condition * ROUNDOFF * np.abs(expected).max()


class TestVectorisedGraph:
    @pytest.mark.parametrize("samples", [0, 1, 7, 64, 65, 200])
    def test_agrees_with_fast_whatever_the_blocks(self, wu2012, samples):
        motion = random_motion(wu2012, 1, samples=samples)
        given = VectorisedGraph(wu2012, block=64).inverse_dynamics(motion)
        assert given.shape == (samples, 6)
        assert_close(given, sixsps.compile(wu2012).inverse_dynamics(motion), wu2012, motion)

    @pytest.mark.parametrize("seed", range(10))
    @pytest.mark.parametrize("name", SIGNATURES)
    def test_agrees_with_the_kernel_of_every_function(self, name, seed):
        mechanism = random_mechanism(seed)
        motion = random_motion(mechanism, seed, samples=5)
        found = VectorisedGraph(mechanism, name, block=3).evaluate(motion)
        for output, expected in kernel_outputs(name, sixsps.compile(mechanism, 1), motion).items():
            assert_close(found[output], expected.reshape(5, -1), mechanism, motion)

    @pytest.mark.parametrize("name", SIGNATURES)
    def test_no_buffer_is_taken_while_its_value_is_needed(self, name):
        one = graph(name)
        places, rows = buffer_places(one)
        assert set(places) == set(one.per_sample)
        assert set(places.values()) == set(range(rows))
        held = {places[k]: k for k in one.per_sample if one.nodes[k].operation == "INPUT"}
        assert len(held) == sum(one.nodes[k].operation == "INPUT" for k in one.per_sample)
        for place in one.per_sample:
            node = one.nodes[place]
            for argument in set(node.arguments) & set(places):
                assert held[places[argument]] == argument
            if len(node.arguments) == 3 and node.arguments[2] in places:
                assert places[place] != places[node.arguments[2]]
            if node.operation != "INPUT":
                held[places[place]] = place
        for entries in one.outputs.values():
            assert all(held[places[k]] == k for k in entries if k in places)


def kernel_outputs(name, model, motion):
    if name == "forces":
        return {"F": model.inverse_dynamics(motion)}
    if name == "equations":
        return dict(zip("JC", model.equations(motion), strict=True))
    if name == "leg_motion":
        return vars(model.inverse_kinematics(motion))
    if name == "parameter_derivatives":
        return {"by_parameters": model.parameter_derivatives(motion)}
    found = dict(vars(model.inverse_dynamics_derivatives(motion)))
    return {"F": found.pop("forces"), **found}


class TestPeak:
    STEPS = 300

    def test_every_chain_ends_where_exact_arithmetic_does(self):
        values = arithmetic.start_values()
        given = values.copy()
        factor, term = map(Fraction, (arithmetic.FACTOR, arithmetic.TERM))
        arithmetic.advance(self.STEPS, arithmetic.FACTOR, arithmetic.TERM, given)
        exact = [
            float(factor**self.STEPS * (Fraction(x) - term / (1 - factor)) + term / (1 - factor))
            for x in values
        ]
        # Each of the steps rounds, twice where nothing is fused; the factor does not let errors grow.
        assert np.abs(given - exact).max() <= 2 * self.STEPS * ROUNDOFF * max(exact)
        assert len(set(given.tolist())) == len(given)
        assert np.all(given != values)

    def test_no_step_leaves_the_numbers_as_they_are(self):
        values = arithmetic.start_values()
        arithmetic.advance(0, arithmetic.FACTOR, arithmetic.TERM, values)
        assert np.array_equal(values, arithmetic.start_values())

    @pytest.mark.parametrize("threads", [1, 3])
    def test_every_thread_does_the_work_that_is_counted(self, threads):
        peak = arithmetic.Peak(threads, self.STEPS)
        ends = peak.run()
        assert len(ends) == threads
        assert all(np.array_equal(end, ends[0]) for end in ends)
        assert peak.flops == 2 * self.STEPS * threads * len(ends[0])

    def test_loop_is_made_of_vector_instructions(self):
        if platform.machine() not in ("x86_64", "AMD64") or not llvmlite.binding.get_host_cpu_features().get(
            "fma"
        ):
            pytest.skip("knows the instructions of x86 with fused multiply-add alone")
        arithmetic.advance(1, 1.0, 0.0, arithmetic.start_values())
        (code,) = arithmetic.advance.inspect_asm().values()
        register = {2: "xmm", 4: "ymm", 8: "zmm"}[arithmetic.host_width()]
        assert len(re.findall(rf"vfn?m(?:add|sub)\d+pd\s.*%{register}", code)) >= arithmetic.chains()


class TestTriad:
    @pytest.mark.parametrize("threads", [1, 2, 3])
    def test_whole_array_is_computed(self, threads):
        triad = Triad(0.001)
        triad.c[:] = np.arange(len(triad.c)) % 7
        expected = triad.b + SCALE * triad.c
        assert np.array_equal(triad.run(Workers(threads)), expected)
        assert triad.bytes == 3 * triad.a.nbytes

    def test_shares_are_all_of_it_and_none_twice(self):
        for n in (0, 1, 5, 64):
            for threads in (1, 2, 3, 7):
                parts = Workers(threads).share(lambda start, stop: list(range(start, stop)), n)
                assert [k for part in parts for k in part] == list(range(n))


class TestSlopes:
    @pytest.mark.parametrize("seed", range(5))
    def test_differences_meet_the_exact_derivatives_in_all_24_directions(self, seed):
        mechanism = random_mechanism(seed)
        motion = random_motion(mechanism, seed)
        model = sixsps.compile(mechanism, 1)
        given = slopes.Differences(model, motion).evaluate()
        exact = slopes.exact_slopes(model, motion)
        assert given.shape == exact.shape == (24, len(motion), 6)
        forces = model.inverse_dynamics(motion)
        for k in range(24):
            # Of the forces' rounding over the step, and of a step squared by the pose.
            step = slopes.Differences(model, motion)._steps[k]
            rounding = 1e3 * ROUNDOFF * max(np.abs(forces).max(), step * np.abs(exact[k]).max()) / step
            assert np.abs(given[k] - exact[k]).max() <= rounding + 1e-6 * np.abs(exact[k]).max(), k

    def test_a_turn_is_about_a_world_axis_from_the_left(self, wu2012):
        motion = random_motion(wu2012, 3)
        for axis in range(3):
            turned = slopes.moved(motion, 3 + axis, 0.1).rotation
            expected = Rotation.from_rotvec(0.1 * np.eye(3)[axis]).as_matrix() @ motion.rotation
            np.testing.assert_allclose(turned, expected, atol=16 * ROUNDOFF)
