"""Eighth-order central differences at 0 of a function of one number; error of order STEP^8."""

FIRST = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
SECOND = {1: 8 / 5, 2: -1 / 5, 3: 8 / 315, 4: -1 / 560}
STEP = 1e-2


def slope(function):
    """First derivative."""
    return sum(w * (function(k * STEP) - function(-k * STEP)) for k, w in FIRST.items()) / STEP


def curvature(function):
    """Second derivative."""
    terms = (w * (function(k * STEP) + function(-k * STEP)) for k, w in SECOND.items())
    return (sum(terms) - 205 / 72 * function(0.0)) / STEP**2
