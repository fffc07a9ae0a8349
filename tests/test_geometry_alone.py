"""Mechanisms of geometry alone: kinematics works, dynamics says what is missing."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from cases import random_motion
from numpy.testing import assert_array_equal

import sixsps
from compare.cli import main
from sixsps import symbolic
from sixsps.errors import MechanismError
from sixsps.home import home_position
from sixsps.limits import Limits
from sixsps.mechanism import Mechanism
from sixsps.mechanism_file import parse

WU = Mechanism.load("wu2012")
ANCHORS = (WU.base_anchors, WU.platform_anchors)
BARE = Mechanism.geometry("bare", *ANCHORS, WU.length_limits)
MOTION = random_motion(WU, 1, 20)
POSES = (MOTION.position, MOTION.rotation)
STATE = sixsps.State.of(MOTION)

FILE = """
name: bare
base:
  anchors: [[1, 0, 0], [0.5, 0.9, 0], [-0.5, 0.8, 0.1], [-1, 0, 0], [-0.5, -0.9, 0], [0.6, -0.8, 0]]
platform:
  anchors: [[0.4, 0.1, 0], [0.4, 0.2, 0], [-0.3, 0.3, 0], [-0.4, 0.1, 0.1], [-0.1, -0.5, 0], [0, -0.5, 0]]
"""


def test_kinematics_is_that_of_the_whole_mechanism():
    whole, bare = (sixsps.inverse_kinematics(mechanism, MOTION) for mechanism in (WU, BARE))
    names = ("lengths", "length_rates", "length_accelerations", "jacobian", "condition", "error_growth")
    for name in names:
        assert_array_equal(getattr(bare, name), getattr(whole, name))
    assert_array_equal(home_position(BARE), home_position(WU))


def test_compiled_kinematics_is_that_of_the_whole_mechanism():
    whole, bare = (sixsps.compile(mechanism).inverse_kinematics(MOTION) for mechanism in (WU, BARE))
    for name in ("lengths", "length_rates", "length_accelerations"):
        assert_array_equal(getattr(bare, name), getattr(whole, name))


def test_symbolic_kinematics_needs_no_inertia():
    found = symbolic.evaluate(symbolic.leg_motion(), BARE, MOTION)
    assert_array_equal(found["lengths"], symbolic.evaluate(symbolic.leg_motion(), WU, MOTION)["lengths"])


COMPILED = sixsps.compile(BARE)
DYNAMICS = {
    **{
        name: lambda name=name: sixsps.inverse_dynamics(BARE, MOTION, name)
        for name in ("kane", "casadi", "fast", "lagrange", "newton-euler", "virtual-work", "wu2012-printed")
    },
    "compiled": lambda: COMPILED.inverse_dynamics(MOTION),
    "derivatives": lambda: COMPILED.inverse_dynamics_derivatives(MOTION),
    "equations": lambda: COMPILED.equations(MOTION),
    "one sample": lambda: COMPILED.leg_forces(MOTION.position[0], MOTION.quaternion[0]),
    "one wrong sample": lambda: COMPILED.leg_forces(np.zeros(2), MOTION.quaternion[0]),
    "mass matrix": lambda: sixsps.mass_matrix(BARE, *POSES),
    "bias": lambda: sixsps.bias(BARE, STATE),
    "forward": lambda: sixsps.forward_dynamics(BARE, STATE, np.zeros((20, 6)), MOTION.force, MOTION.moment),
    "kinetic energy": lambda: sixsps.kinetic_energy(BARE, STATE),
    "potential energy": lambda: sixsps.potential_energy(BARE, *POSES),
    "parameters": lambda: sixsps.inertial_parameters(BARE),
    "reactions": lambda: sixsps.joint_reactions(BARE, MOTION),
    "symbolic forces": lambda: symbolic.evaluate(symbolic.forces(), BARE, MOTION),
    "com of a leg": lambda: sixsps.inverse_kinematics(BARE, MOTION).upper_velocity,
    "links": lambda: BARE.lower,
    "gravity as an array": lambda: np.array(BARE.gravity),
    "gravity turned": lambda: -BARE.gravity,
    "gravity times": lambda: BARE.gravity @ np.ones(3),
    "gravity entry": lambda: BARE.gravity[2],
    "twice gravity": lambda: 2 * BARE.gravity,
    "numpy of gravity": lambda: np.ones(3) + BARE.gravity,
    "gravity halved": lambda: BARE.gravity / 2,
    "size of gravity": lambda: len(BARE.gravity),
    "gravity shown": lambda: f"{BARE.gravity:.3f}",
}


@pytest.mark.parametrize("ask", DYNAMICS.values(), ids=DYNAMICS)
def test_dynamics_says_what_is_missing(ask):
    with pytest.raises(MechanismError, match=r"missing; allowed: .*gravity, platform\.mass.*geometry alone"):
        ask()


@pytest.mark.parametrize(
    "words",
    [
        ["compare", "{}", "line"],
        ["forces", "{}", "line", "--output", "forces.csv"],
        ["forces", "{}", "line", "--engine", "fast", "--output", "forces.csv"],
        ["forces", "{}", "line", "--reactions", "--output", "forces.csv"],
        ["simulate", "{}", "line"],
        ["modes", "{}", "--stiffness", "1e6"],
        ["export", "urdf", "{}", "--output", "description"],
        ["export", "mjcf", "{}", "--output", "description"],
        ["export", "c", "{}", "--output", "controller"],
        ["export", "driving-functions", "{}", "line", "--format", "json", "--output", "forces.json"],
    ],
    ids=lambda words: " ".join(words[:2]),
)
def test_commands_that_need_inertia_refuse_in_one_line(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    BARE.save("bare.yaml")
    monkeypatch.setattr("sys.argv", ["sixsps", *(word.format("bare.yaml") for word in words)])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "missing; allowed: a mechanism with gravity" in line
    assert list(tmp_path.iterdir()) == [tmp_path / "bare.yaml"]


def test_inverse_kinematics_on_the_command_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    BARE.save("bare.yaml")
    for name in ("bare.yaml", "wu2012"):
        monkeypatch.setattr(
            "sys.argv", ["sixsps", "ik", name, "circle", "--rates", "--output", f"{name}.csv"]
        )
        with pytest.raises(SystemExit) as stop:
            main()
        assert not stop.value.code
    assert (tmp_path / "bare.yaml.csv").read_text() == (tmp_path / "wu2012.csv").read_text()


def test_a_file_needs_name_and_anchors_only():
    mechanism = parse(FILE.encode(), "bare.yaml")
    assert not mechanism.has_inertia
    assert_array_equal(mechanism.length_limits, [[0, np.inf]] * 6)
    with pytest.raises(MechanismError, match=r"legs\.length_limits: missing"):
        home_position(mechanism)


@pytest.mark.parametrize(
    "mechanism",
    [
        BARE,
        Mechanism.load("dietmaier1998"),
        Mechanism.geometry("each its own", *ANCHORS, [[0.1 * k, 1] for k in range(6)]),
        Mechanism.geometry("limits", *ANCHORS, limits=Limits(clearance=0.1)),
        Mechanism.geometry("some limits", *ANCHORS, [[0, np.inf], [0.3, 1], [0.3, np.inf], *[[0, 2]] * 3]),
        replace(BARE, gravity=np.array([0, 0, -9.81])),
    ],
    ids=lambda mechanism: mechanism.name,
)
def test_survives_file_and_pickle(mechanism, tmp_path):
    mechanism.save(tmp_path / "again.yaml")
    for again in (Mechanism.load(tmp_path / "again.yaml"), pickle.loads(pickle.dumps(mechanism))):
        assert again == mechanism
        assert again.sha256 == mechanism.sha256
        assert not again.has_inertia
        assert_array_equal(again.length_limits, mechanism.length_limits)


LINK = "{mass: 1, length: 1, radius: 0.1}"
FORGOTTEN = {
    "mass alone": ("platform:\n", "platform:\n  mass: 1\n", "gravity"),
    "com alone": ("platform:\n", "platform:\n  com: [0, 0, 0]\n", "gravity"),
    "one link": ("platform:\n", f"legs: {{lower: {LINK}}}\nplatform:\n", "gravity"),
    "links alone": ("platform:\n", f"legs: {{lower: {LINK}, upper: {LINK}}}\nplatform:\n", "gravity"),
}


@pytest.mark.parametrize(("old", "new", "place"), FORGOTTEN.values(), ids=FORGOTTEN)
def test_some_inertia_means_that_the_rest_was_forgotten(old, new, place):
    with pytest.raises(MechanismError) as caught:
        parse(FILE.replace(old, new).encode(), "bare.yaml")
    assert caught.value.place == place
    assert caught.value.value == "missing"


@pytest.mark.parametrize("name", ["gravity", "platform"])
def test_some_inertia_in_python_means_so_too(name):
    with pytest.raises(MechanismError, match=f"{name}: missing"):
        replace(WU, **{name: getattr(BARE, name)})
    with pytest.raises(MechanismError, match=r"legs\.3\.lower: missing"):
        replace(WU, legs=[*WU.legs[:3], sixsps.Leg(), *WU.legs[4:]])
    with pytest.raises(MechanismError, match="upper: missing"):
        sixsps.Leg(WU.legs[0].lower)


def test_any_length_is_a_length_limit():
    again = Mechanism.geometry("again", *ANCHORS, Mechanism.load("dietmaier1998").length_limits)
    assert_array_equal(again.length_limits, [[0, np.inf]] * 6)
    for wrong in ([0.3, np.nan], [np.inf, np.inf], [[0.1, 1]] * 5, "long", [0.5, -np.inf], [0.3, "1"]):
        with pytest.raises(MechanismError, match="length_limits"):
            Mechanism.geometry("wrong", *ANCHORS, wrong)
    with pytest.raises(MechanismError, match="length_limits"):
        replace(WU.legs[0], length_limits=(0.3, np.inf))


def test_what_is_missing_is_false_and_says_so():
    assert not BARE.platform
    assert repr(BARE.gravity) == "missing"
    assert "platform=missing" in repr(BARE)


def test_limits_are_limits():
    with pytest.raises(MechanismError, match="limits"):
        Mechanism.geometry("wrong", *ANCHORS, limits={"rate": 1})


def hanging(gravity, turn=None, scale=1.0):
    """Home of wu2012 as geometry with gravity, its base turned and its lengths scaled."""
    R = np.eye(3) if turn is None else turn
    mechanism = Mechanism.geometry("h", *(scale * one @ R.T for one in ANCHORS), scale * WU.length_limits)
    return home_position(mechanism if gravity is None else replace(mechanism, gravity=np.array(gravity)))


def test_home_is_above_the_base_as_gravity_has_it():
    up = hanging(None)
    assert up[2] > 0
    assert_array_equal(hanging([0, 0, -9.81]), up)
    np.testing.assert_allclose(hanging([0, 0, 9.81]), -up, rtol=0, atol=1e-15)
    wall = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # the normal of the base along y
    for noise in (0.0, 1e-17, -1e-17):
        turned = hanging([noise, 9.81 * noise, -9.81], wall + noise)
        np.testing.assert_allclose(turned, [0, up[2], 0], rtol=0, atol=1e-14)


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1e6])
def test_home_is_as_exact_in_any_unit(scale):
    np.testing.assert_allclose(hanging(None, scale=scale) / scale, hanging(None), rtol=0, atol=1e-14)


@pytest.mark.parametrize("ask", [sixsps.compile, lambda name: sixsps.assembly_modes(name, [1.0] * 6)])
def test_a_name_is_no_mechanism(ask):
    with pytest.raises(sixsps.InputError, match=r"mechanism: wu2012; allowed: a Mechanism"):
        ask("wu2012")
