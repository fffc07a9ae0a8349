"""Mechanism, Platform, Leg and Link: what they refuse, and that nothing in them can be written."""

import math
import pickle
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from texts import BENCH

from sixsps.bodies import Leg, Link, Platform
from sixsps.errors import MechanismError

LINK = Link(mass=0.5, length=0.45, com=0.2, transverse=0.008, axial=1e-4)
LEG = Leg(LINK, LINK)
INERTIA = np.diag([0.0025, 0.0025, 0.005])


def link(**changes):
    return Link(**{"mass": 0.5, "length": 0.45, "com": 0.2, "transverse": 0.008, "axial": 1e-4} | changes)


@pytest.mark.parametrize("value", [0, -1.0, math.nan, math.inf, "1", None, True, [1.0]])
@pytest.mark.parametrize("name", ["mass", "length", "transverse", "axial"])
def test_a_link_refuses_what_is_no_positive_number(name, value):
    with pytest.raises(MechanismError, match=f"{name}: .*; allowed: "):
        link(**{name: value})


@pytest.mark.parametrize("value", [math.nan, -math.inf, "0.2", None, [0.2], True])
def test_a_link_refuses_a_centre_of_mass_that_is_no_number(value):
    with pytest.raises(MechanismError, match=r"^com: .*; allowed: "):
        link(com=value)


@pytest.mark.parametrize("numbers", [(1, 1, 1e200), (1, 1e200, 1), (1e308, 1e10, 1), (1, 1, 1e-200)])
def test_a_cylinder_out_of_the_range_of_floats_is_refused(numbers):
    with pytest.raises(MechanismError, match="; allowed: "):
        Link.solid_cylinder(*numbers)


def test_axial_inertia_up_to_twice_transverse_is_possible():
    assert link(axial=0.016).axial == 0.016
    with pytest.raises(MechanismError, match=r"inertia\.axial: 0\.0161; allowed: .*0\.016 kg m\^2"):
        link(axial=0.0161)


@pytest.mark.parametrize("limits", [(0.5, 0.5), (0.9, 0.5), (-0.1, 0.5), (0.1, math.inf), (math.nan, 0.5)])
def test_a_leg_refuses_impossible_limits(limits):
    with pytest.raises(MechanismError, match="length_limits"):
        Leg(LINK, LINK, limits)


@pytest.mark.parametrize("limits", [(), (0.5,), (0.1, 0.2, 0.3), 0.5, "ab"])
def test_a_leg_refuses_what_are_no_two_limits(limits):
    with pytest.raises(MechanismError, match="length_limits"):
        Leg(LINK, LINK, limits)


def test_limits_given_as_a_list_or_an_array_are_kept_as_a_frozen_pair():
    for limits in ([0.5, 0.8], np.array([0.5, 0.8])):
        leg = Leg(LINK, LINK, limits)
        assert leg == Leg(LINK, LINK, (0.5, 0.8))
        assert hash(leg) == hash(Leg(LINK, LINK, (0.5, 0.8)))


PLATFORMS = {
    "mass": ({"mass": -1.0}, "platform.mass: -1.0"),
    "com shape": ({"com": [0, 0]}, "platform.com: shape (2,)"),
    "com NaN": ({"com": [0, math.nan, 0]}, "platform.com[1]: nan"),
    "inertia shape": ({"inertia": [1, 1, 1]}, "platform.inertia: shape (3,)"),
    "inertia infinite": ({"inertia": np.diag([1, math.inf, 1])}, "platform.inertia[1, 1]: inf"),
    "inertia text": ({"inertia": "big"}, "platform.inertia: big"),
    "not symmetric": ({"inertia": np.triu(np.ones((3, 3)))}, "a symmetric matrix"),
    "not positive": ({"inertia": np.diag([1.0, 1.0, 0.0])}, "positive principal moments"),
    "not positive off the axes": (
        {"inertia": np.ones((3, 3)) + np.eye(3) * 1e-9 - 2e-9},
        "principal moments",
    ),
    "triangle": ({"inertia": np.diag([1.0, 1.0, 2.001])}, "sum of the other two"),
}


@pytest.mark.parametrize(("changes", "says"), PLATFORMS.values(), ids=PLATFORMS)
def test_a_platform_refuses_what_no_rigid_body_has(changes, says):
    with pytest.raises(MechanismError) as caught:
        Platform(**{"mass": 1.0, "com": [0, 0, 0], "inertia": INERTIA} | changes)
    assert says in str(caught.value)


def test_a_thin_plate_is_a_rigid_body():
    angle = 0.3
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    tilt = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    turned = turn @ tilt @ np.diag([1.0, 2.0, 3.0]) @ tilt.T @ turn.T
    for inertia in (np.diag([1.0, 2.0, 3.0]), (turned + turned.T) / 2):
        assert_array_equal(Platform(1.0, [0, 0, 0], inertia).inertia, inertia)


MECHANISMS = {
    "gravity shape": ({"gravity": [0, -9.81]}, "gravity: shape (2,); allowed: shape (3)"),
    "gravity scalar": ({"gravity": -9.81}, "gravity: shape (); allowed: shape (3)"),
    "gravity ragged": ({"gravity": [0, [0, 0], -9.81]}, "gravity"),
    "anchors transposed": (
        {"base_anchors": np.ones((3, 6))}, "base.anchors: shape (3, 6); allowed: shape (6, 3)",
    ),
    "anchors NaN": ({"platform_anchors": np.full((6, 3), math.nan)}, "platform.anchors[0, 0]: nan"),
    "five legs": ({"legs": [LEG] * 5}, "legs: 5 legs; allowed: six legs"),
    "seven legs": ({"legs": [LEG] * 7}, "legs: 7 legs; allowed: six legs"),
    "all in one point": ({"platform_anchors": np.zeros((6, 3))}, "platform.anchors: 6 anchors coincide"),
    "name": ({"name": 5}, "name: 5; allowed: printable text"),
    # the checks must not warn on the way
    "huge anchors": ({"base_anchors": 1e200 * np.eye(6, 3)}, "anchors"),
    "huge platform": ({"platform_anchors": 1e200 * np.eye(6, 3)}, "anchors"),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "says"), MECHANISMS.values(), ids=MECHANISMS)
def test_a_mechanism_refuses_what_no_hexapod_has(changes, says):
    with pytest.raises(MechanismError) as caught:
        replace(BENCH, **changes)
    assert says in str(caught.value)


@pytest.mark.parametrize("group", ["base", "platform"])
def test_pairs_of_coincident_anchors_are_a_real_mechanism(group):
    anchors = np.array(getattr(BENCH, f"{group}_anchors"))
    anchors[1::2] = anchors[::2]
    assert replace(BENCH, **{f"{group}_anchors": anchors}).name == "bench"


def test_no_array_of_a_mechanism_can_be_written():
    arrays = [BENCH.gravity, BENCH.base_anchors, BENCH.platform_anchors, BENCH.length_limits]
    arrays += [BENCH.platform.com, BENCH.platform.inertia]
    for links in (BENCH.lower, BENCH.upper):
        arrays += [links.mass, links.length, links.com, links.transverse, links.axial]
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


def test_no_attribute_of_a_mechanism_can_be_set():
    for thing, name in (
        (BENCH, "gravity"),
        (BENCH, "name"),
        (BENCH.platform, "mass"),
        (BENCH.legs[0], "lower"),
        (BENCH.legs[0].lower, "mass"),
    ):
        with pytest.raises(FrozenInstanceError):
            setattr(thing, name, getattr(thing, name))


def test_arrays_given_to_a_mechanism_are_copied():
    anchors = np.array(BENCH.base_anchors)
    mechanism = replace(BENCH, base_anchors=anchors)
    anchors[0, 0] = 7
    assert mechanism.base_anchors[0, 0] == 0.24
    assert mechanism == BENCH


def test_mechanisms_differ_by_any_number_and_by_name():
    assert replace(BENCH, gravity=[0, 0, -9.80665]) != BENCH
    assert replace(BENCH, name="other") != BENCH
    assert BENCH != "bench"


def test_the_hash_is_of_the_numbers_alone():
    assert replace(BENCH, name="other", source="a book").sha256 == BENCH.sha256
    assert replace(BENCH, gravity=[0, 0, -9.80665]).sha256 != BENCH.sha256


def test_comes_back_from_a_pickle_equal_and_frozen():
    again = pickle.loads(pickle.dumps(replace(BENCH, assumed={"gravity": "why"})))
    assert again == replace(BENCH, assumed={"gravity": "why"})
    with pytest.raises(ValueError, match="read-only"):
        again.gravity[0] = 1
    with pytest.raises(TypeError):
        again.assumed["x"] = "y"


def test_assumed_is_a_copy():
    given = {"gravity": "why"}
    mechanism = replace(BENCH, assumed=given)
    given["mass"] = "changed behind its back"
    assert dict(mechanism.assumed) == {"gravity": "why"}


def test_single_precision_scalars_are_taken_as_their_double():
    link = Link(np.float32(0.5), np.float32(0.45), np.float32(0.2), np.float32(0.008), np.float32(1e-4))
    assert type(link.mass) is float
    assert link.mass == 0.5
    cylinder = Link.solid_cylinder(np.float32(0.5), np.float32(0.5), np.float32(0.25))
    assert cylinder == Link.solid_cylinder(0.5, 0.5, 0.25)
