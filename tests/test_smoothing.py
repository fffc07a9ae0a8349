"""The smoothing spline against its variational definition, its filter, and signals that are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from sixsps.smoothing import FEWEST_SAMPLES, fit

EPS = np.finfo(float).eps
# Twenty knots to a period of the cutoff: the stiffest curve that the knots can draw, at half their rate, is
# resisted 10^6 times as much as one at the cutoff. That is the condition of the normal equations, and what
# rounding grows by.
CONDITION = 1e6
# How closely the logarithm of the cutoff is found, stated in smoothing.py as xatol; twice, for two fits.
CUTOFF_TOLERANCE = 0.02


def sines(time, order=0):
    """Two sines, 0.8 and 1.7 Hz, or their derivative: the simplest motion, with nothing above 1.7 Hz."""
    return sum(
        size * (2 * np.pi * f) ** order * np.sin(2 * np.pi * f * time + phase + order * np.pi / 2)
        for size, f, phase in ((0.1, 0.8, 0.0), (0.05, 1.7, 1.0))
    )


def broad(time, order=0):
    """A motion with power at all frequencies up to 20 Hz, falling as f^-4 above 1 Hz like a hand's."""
    frequency = 0.05 * np.arange(1, 400)
    size = 0.02 / (1 + frequency**4)
    phase = np.random.default_rng(99).uniform(0, 2 * np.pi, len(frequency))
    angle = 2 * np.pi * np.outer(time, frequency) + phase + order * np.pi / 2
    return np.sin(angle) @ (size * (2 * np.pi * frequency) ** order)


def even_times(samples, rate=100.0):
    return np.arange(samples) / rate


def jittered_times(samples, seed, rate=100.0, jitter=0.3):
    """Sampling instants off an even grid by up to `jitter` of a step, from time 0."""
    rng = np.random.default_rng(seed)
    time = (np.arange(samples) + jitter * rng.uniform(-1, 1, samples)) / rate
    return time - time[0]


def noisy(signal, time, noise, seed, columns=3):
    rng = np.random.default_rng(1000 + seed)
    return signal(time)[:, None] + noise * rng.standard_normal((len(time), columns))


def interior(time, margin=1.0):
    """Samples further than `margin` seconds from both ends, where the spline is the filter."""
    return (time > time[0] + margin) & (time < time[-1] - margin)


def acceleration_error(result, time, signal):
    inside = interior(time)
    error = result(time[inside], 2) - signal(time[inside], 2)[:, None]
    return float(np.sqrt(np.mean(error**2)))


def natural_smoothing_spline(time, samples, cutoff):
    """Values at the samples of the exact minimiser, by divided differences and dense algebra.

    The third derivative of the minimiser is a sum of the B-splines M_i of degree 2 on the samples, each of
    integral 1, for which the divided difference of four samples is the integral of M_i y''' / 6.
    """
    n = len(time)
    weight = (n - 1) / (time[-1] - time[0]) / (2 * np.pi * cutoff) ** 6
    divided, gram = np.zeros((n - 3, n)), np.zeros((n - 3, n - 3))
    nodes, weights = np.polynomial.legendre.leggauss(3)
    half, middle = np.diff(time)[:, None] / 2, (time[1:] + time[:-1])[:, None] / 2
    points, weights = (middle + half * nodes).ravel(), (half * weights).ravel()
    splines = []
    for i in range(n - 3):
        knots = time[i : i + 4]
        divided[i, i : i + 4] = [1 / np.prod(np.delete(knots[j] - knots, j)) for j in range(4)]
        element = BSpline.basis_element(knots, extrapolate=False)
        splines.append(np.nan_to_num(element(points)) * 3 / (knots[3] - knots[0]))
    gram = (np.array(splines) * weights) @ np.array(splines).T
    penalty = 36 * divided.T @ np.linalg.solve(gram, divided)
    return np.linalg.solve(np.eye(n) + weight * penalty, samples)


@pytest.mark.parametrize("cutoff_per_rate", [0.05, 0.1, 0.3, 0.5])
@pytest.mark.parametrize("samples", [6, 20, 80])
def test_even_samples_get_the_exact_natural_smoothing_spline(samples, cutoff_per_rate):
    time = even_times(samples, 20.0)
    data = noisy(sines, time, 0.1, samples)
    cutoff = 20.0 * cutoff_per_rate
    # Here the exact minimiser has its knots where `fit` has them; at 0.05 they are just as close.
    exact = natural_smoothing_spline(time, data, cutoff)
    np.testing.assert_allclose(fit(time, data, cutoff)(time), exact, rtol=0, atol=CONDITION * EPS)


@pytest.mark.parametrize("samples", [6, 20, 80])
def test_uneven_samples_get_the_natural_smoothing_spline_too(samples):
    time = jittered_times(samples, samples, 20.0)
    data = noisy(sines, time, 0.1, samples)
    exact = natural_smoothing_spline(time, data, 1.0)
    # Even knots draw what the filter lets through of the noise, the less above the cutoff the better: at
    # half the knots' rate that is (1/10)^6 of 0.1.
    np.testing.assert_allclose(fit(time, data, 1.0)(time), exact, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("samples", "cutoff_cycles"),
    [(6, 0.3), (6, 1), (6, 2.5)] + [(n, cycles) for n in (200, 2000) for cycles in (0.3, 1, 5, 25, 90)],
)
def test_quadratics_pass_unsmoothed(samples, cutoff_cycles):
    time = jittered_times(samples, 5, rate=samples)
    duration = time[-1]
    cutoff = cutoff_cycles / duration
    tau = time / duration
    data = np.column_stack([3 - 2 * tau + 5 * tau**2, 4 * tau - 1, np.full(samples, -2.0)])
    slopes = np.column_stack([-2 + 10 * tau, np.full(samples, 4.0), np.zeros(samples)]) / duration
    curvature = np.array([10.0, 0.0, 0.0]) / duration**2
    spline = fit(time, data, cutoff)
    # Rounding of the values, 6 at most, at the knots' frequency when it is differentiated.
    rounding = 6 * CONDITION * EPS * 10
    pulsation = 2 * np.pi * max(cutoff, 1 / duration)
    np.testing.assert_allclose(spline(time), data, rtol=0, atol=rounding)
    np.testing.assert_allclose(spline(time, 1), slopes, rtol=0, atol=rounding * pulsation)
    np.testing.assert_allclose(
        spline(time, 2), np.tile(curvature, (samples, 1)), rtol=0, atol=rounding * pulsation**2
    )


@pytest.mark.parametrize("ratio", [0.5, 0.8, 1.0, 1.25, 1.6, 2.0])
@pytest.mark.parametrize(("rate", "cutoff"), [(100.0, 5.0), (100.0, 2.0), (1000.0, 5.0)])
def test_cutoff_is_the_corner_of_the_stated_filter(rate, cutoff, ratio):
    time = even_times(int(60 * rate / cutoff), rate)
    angle = 2 * np.pi * ratio * cutoff * time
    waves = np.column_stack([np.sin(angle), np.cos(angle)])
    result = fit(time, waves[:, :1], cutoff)(time)
    # Ends disturb a curve over some 1 / (2 pi cutoff); 12 cycles away that is far below rounding.
    inside = interior(time, 12 / cutoff)
    (gain, shift), *_ = np.linalg.lstsq(waves[inside], result[inside, 0], rcond=None)
    # Sampled at, or drawn by knots at, 20 cutoffs, waves of f and 20 cutoffs - f are one: (f / (20 - f))^6.
    aliasing = 2 * (ratio / (20 - ratio)) ** 6 + CONDITION * EPS
    assert gain == pytest.approx(1 / (1 + ratio**6), rel=aliasing * (1 + ratio**6))
    assert shift == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("times", [even_times(1000), jittered_times(1000, 1)], ids=["even", "jittered"])
@pytest.mark.parametrize("signal", [sines, broad])
def test_samples_without_noise_are_not_smoothed(times, signal):
    result = fit(times, signal(times)[:, None])
    inside = interior(times)
    truth = signal(times[inside], 2)
    # Ten times the highest frequency of `sines`.
    assert result.cutoff > 17
    scale = float(np.sqrt(np.mean(truth**2)))
    # `sines` lose at most (1.7 / 17)^6 = 1e-6, and jitter makes that uneven, which differentiation
    # magnifies. `broad` has 1e-5 of its size at 20 Hz, 400 times faster than its body, and loses a part.
    assert acceleration_error(result, times, signal) < (1e-5 if signal is sines else 2e-3) * scale


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("noise", [1e-6, 1e-5, 1e-4, 1e-3, 1e-2])
def test_chosen_cutoff_is_nearly_the_best_one_for_a_broad_motion(noise, seed):
    time = jittered_times(1000, seed)
    data = noisy(broad, time, noise, seed)
    found = acceleration_error(fit(time, data), time, broad)
    best = min(acceleration_error(fit(time, data, c), time, broad) for c in np.geomspace(1, 45, 30))
    # 1.08 is the worst that was seen.
    assert found < 1.15 * best


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(("noise", "factor"), [(1e-4, 3.0), (1e-3, 1.75), (1e-2, 1.3)])
def test_chosen_cutoff_is_not_far_from_the_best_one_for_pure_sines(noise, factor, seed):
    # Cross-validation looks for the best positions. For a motion that has nothing at all beyond 1.7 Hz
    # those allow a higher cutoff than accelerations do, and the more so the less noise there is.
    time = jittered_times(1000, seed)
    data = noisy(sines, time, noise, seed)
    found = acceleration_error(fit(time, data), time, sines)
    best = min(acceleration_error(fit(time, data, c), time, sines) for c in np.geomspace(1, 45, 30))
    assert found < factor * best


@pytest.mark.parametrize("signal", [sines, broad])
@pytest.mark.parametrize("noise", [1e-5, 1e-3])
def test_reported_noise_is_the_noise(signal, noise):
    time = jittered_times(2000, 4)
    result = fit(time, noisy(signal, time, noise, 4))
    # The curve follows part of the noise: of n samples, at most a third at these cutoffs.
    assert np.sqrt(2 / 3) * noise < result.noise < 1.05 * noise


def test_more_noise_is_smoothed_more():
    time = jittered_times(1000, 2)
    cutoffs = [fit(time, noisy(broad, time, noise, 2)).cutoff for noise in (0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)]
    assert all(np.diff(cutoffs) < 0)


@pytest.mark.parametrize("factor", [1e-6, -3.7, 1024.0])
def test_scaling_the_samples_scales_the_curve(factor):
    time = jittered_times(400, 6)
    data = noisy(sines, time, 1e-3, 6)
    free, scaled = fit(time, data), fit(time, factor * data)
    assert abs(np.log(scaled.cutoff / free.cutoff)) < CUTOFF_TOLERANCE
    same = fit(time, factor * data, free.cutoff)
    assert same.noise == pytest.approx(abs(factor) * free.noise, rel=1e-9)
    for order in range(3):
        expected = factor * free(time, order)
        rounding = CONDITION * EPS * np.abs(expected).max() * 10
        np.testing.assert_allclose(same(time, order), expected, rtol=0, atol=rounding)


@pytest.mark.parametrize("factor", [2.0**-10, 0.7, 60.0])
def test_scaling_time_scales_the_cutoff_inversely(factor):
    time = jittered_times(400, 6)
    data = noisy(sines, time, 1e-3, 6)
    free, scaled = fit(time, data), fit(factor * time, data)
    assert abs(np.log(scaled.cutoff * factor / free.cutoff)) < CUTOFF_TOLERANCE
    same = fit(factor * time, data, free.cutoff / factor)
    for order in range(3):
        expected = free(time, order) / factor**order
        rounding = CONDITION * EPS * np.abs(expected).max() * 10
        np.testing.assert_allclose(same(factor * time, order), expected, rtol=0, atol=rounding)


def test_adding_a_quadratic_changes_nothing_but_the_quadratic():
    time = jittered_times(1000, 8)
    data = noisy(sines, time, 1e-3, 8)
    parabola = np.polynomial.Polynomial([2.0, -1.0, 0.3])
    free, raised = fit(time, data), fit(time, data + parabola(time)[:, None])
    assert abs(np.log(raised.cutoff / free.cutoff)) < CUTOFF_TOLERANCE
    same = fit(time, data + parabola(time)[:, None], free.cutoff)
    rounding = CONDITION * EPS * np.abs(parabola(time)).max()
    for order in range(3):
        added = same(time, order) - free(time, order)
        expected = parabola.deriv(order)(time) if order else parabola(time)
        bound = rounding * (2 * np.pi * free.cutoff) ** order
        np.testing.assert_allclose(added, np.tile(expected[:, None], 3), rtol=0, atol=bound)


@pytest.mark.parametrize("value", [0.0, 1.0, -1e-9, 1e5])
@pytest.mark.parametrize("samples", [6, 500])
def test_constant_samples_stay_constant(samples, value):
    time = jittered_times(samples, 9)
    result = fit(time, np.full((samples, 2), value))
    pulsation = 2 * np.pi * max(result.cutoff, 1 / time[-1])
    rounding = CONDITION * EPS * abs(value)
    np.testing.assert_allclose(result(time), value, rtol=0, atol=rounding)
    np.testing.assert_allclose(result(time, 1), 0, rtol=0, atol=rounding * pulsation)
    np.testing.assert_allclose(result(time, 2), 0, rtol=0, atol=rounding * pulsation**2)
    assert result.noise <= rounding


def test_all_columns_get_one_amount_of_smoothing():
    time = jittered_times(500, 10)
    data = noisy(sines, time, 1e-3, 10)
    together = fit(time, data)
    for column in range(3):
        alone = fit(time, data[:, [column]], together.cutoff)
        np.testing.assert_allclose(alone(time, 2)[:, 0], together(time, 2)[:, column], rtol=0, atol=1e-9)


@settings(max_examples=30)
@given(steps=st.lists(st.floats(-2, 0), min_size=5, max_size=40), seed=st.integers(0, 99))
def test_clustered_times_leave_residuals_that_no_quadratic_explains(steps, seed):
    # A quadratic costs no penalty, so the best curve has already taken up all of it.
    time = np.r_[0.0, np.cumsum(10.0 ** np.array(steps))]
    data = np.random.default_rng(seed).standard_normal((len(time), 2))
    result = fit(time, data)
    residual = data - result(time)
    tau = time / time[-1]
    for power in range(3):
        np.testing.assert_allclose(tau**power @ residual, 0, rtol=0, atol=CONDITION * EPS * 10 * len(time))
    assert 0 < result.cutoff < len(time) / time[-1]
    assert np.isfinite(result(time, 2)).all()


def test_six_samples_are_enough():
    assert FEWEST_SAMPLES == 6
    time = np.array([0.0, 0.1, 0.35, 0.5, 0.8, 1.0])
    cubic = (time**3 - time**2)[:, None]
    # At half the sampling rate of 5 Hz little is smoothed, most at the free ends.
    np.testing.assert_allclose(fit(time, cubic, 2.5)(time), cubic, rtol=0, atol=1e-3)
    free = fit(time, cubic)
    assert 0 < free.cutoff <= 2.5
    assert free.noise < np.abs(cubic).max()


def test_the_curve_is_a_function_of_the_given_times():
    # Steps of 1/64 s, which float64 holds exactly at 1024 s too.
    time = np.arange(500) / 64.0
    data = noisy(sines, time, 1e-3, 11)
    near, far = fit(time, data), fit(time + 1024.0, data)
    assert far.cutoff == near.cutoff
    for order in range(3):
        expected = near(time, order)
        # Knots some 1e-2 s apart are rounded to 1e-13 s, and each derivative divides by their distance.
        slack = 1e-11 * 10.0 ** (2 * order)
        np.testing.assert_allclose(far(time + 1024.0, order), expected, rtol=0, atol=slack)


@pytest.mark.parametrize("pause", [0.5, 5.0, 50.0])
def test_samples_on_both_sides_of_a_pause_are_smoothed_as_ever(pause):
    time = even_times(2000)
    time[1000:] += pause
    data = noisy(sines, time, 1e-3, 12)
    inside = interior(time[:1000]), interior(time[1000:])
    result = fit(time, data)
    error = (result(time, 2) - sines(time, 2)[:, None])[np.r_[inside]]
    unbroken = even_times(2000)
    usual = acceleration_error(fit(unbroken, noisy(sines, unbroken, 1e-3, 12)), unbroken, sines)
    assert np.sqrt(np.mean(error**2)) < 1.2 * usual


@pytest.mark.parametrize("noise", [0.0, 1e-9, 1e-4])
def test_slow_motion_sampled_at_ten_kilohertz(noise):
    time = even_times(20000, 10_000.0)
    signal = np.sin(2 * np.pi * time)[:, None]
    data = signal + noise * np.random.default_rng(14).standard_normal((20000, 1))
    result = fit(time, data)
    truth = -((2 * np.pi) ** 2) * signal
    inside = interior(time, 0.2)
    error = np.sqrt(np.mean((result(time, 2) - truth)[inside] ** 2))
    # White noise through filter and two derivatives; without noise, rounding at the samples' 1 ulp.
    expected = max(noise, EPS) * np.sqrt((2 * np.pi * result.cutoff) ** 5 / 10_000.0 / 18)
    assert error < 1.5 * expected + CONDITION * EPS * (2 * np.pi * 20) ** 2
    assert 1 < result.cutoff < 5000


def test_twenty_thousand_samples():
    time = jittered_times(20000, 15)
    data = noisy(broad, time, 1e-4, 15)
    result = fit(time, data)
    # Long data tell the cutoff well: the same motion and noise, a tenth of it.
    short = fit(time[:2000], data[:2000])
    assert abs(np.log(result.cutoff / short.cutoff)) < 0.1
    assert result.noise == pytest.approx(1e-4, rel=0.15)
