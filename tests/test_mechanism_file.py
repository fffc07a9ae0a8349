"""Mechanism files: read and written exactly, and refused with the line and key at fault."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from cases import BUNDLED, random_mechanism
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from texts import BENCH, MECHANISM, edited, line_of, mechanism_refusal, read

from sixsps.bodies import Leg, Link
from sixsps.errors import MechanismError, OutputError
from sixsps.mechanism import Mechanism
from sixsps.mechanism_file import bundled_mechanisms

ARRAYS = ("gravity", "base_anchors", "platform_anchors")
FIELDS = ("mass", "length", "com", "transverse", "axial")


def mapping():
    """The bench as plain data; YAML 1.1 would read 1e-4 as text."""
    return yaml.safe_load(edited("1e-4", "1.0e-4").replace("2e-5", "2.0e-5"))


def reread(mechanism, folder):
    path = folder / "again.yaml"
    mechanism.save(path)
    return Mechanism.load(path)


def bits(mechanism):
    """All numbers of a mechanism, as bytes."""
    numbers = [getattr(mechanism, name) for name in ARRAYS]
    numbers += [mechanism.platform.mass, mechanism.platform.com, mechanism.platform.inertia]
    for leg in mechanism.legs:
        numbers += [getattr(link, name) for link in (leg.lower, leg.upper) for name in FIELDS]
        numbers += leg.length_limits
    return b"".join(np.asarray(number, dtype="<f8").tobytes() for number in numbers)


@pytest.mark.parametrize("seed", range(5))
def test_saving_and_loading_gives_the_same_mechanism_bit_for_bit(seed, tmp_path):
    mechanism = random_mechanism(seed)
    again = reread(mechanism, tmp_path)
    assert again == mechanism
    assert bits(again) == bits(mechanism)
    assert again.sha256 == mechanism.sha256
    assert hash(again) == hash(mechanism)


def test_bundled_mechanisms_survive_saving(mechanism, tmp_path):
    again = reread(mechanism, tmp_path)
    assert again == mechanism
    assert bits(again) == bits(mechanism)
    assert (again.source, again.assumed) == (mechanism.source, mechanism.assumed)


@given(st.lists(st.floats(min_value=5e-324, max_value=1e50), min_size=4, max_size=4))
@example([5e-324, 0.1 + 0.2, 1e22, 9.999999999999999e49])
@example([1e-4, 1e16, 123456789.123456789, 2.2250738585072014e-308])
def test_awkward_floats_survive_saving(tmp_path_factory, values):
    mass, length, com, transverse = values
    lower, upper = Link(mass, length, -com, transverse, transverse), Link(0.5, 0.45, 0.2, 0.008, 1e-4)
    leg = Leg(lower, upper, (0.0, length))
    mechanism = replace(read(MECHANISM), gravity=[-0.0, com, -mass], legs=[leg] * 6)
    assert bits(reread(mechanism, tmp_path_factory.getbasetemp())) == bits(mechanism)


# Plain text for YAML 1.1, which PyYAML writes, and a number for YAML 1.2, which is read.
@pytest.mark.parametrize("text", ["1e5", "1.5e5", "08", "-.5"])
def test_text_that_looks_like_a_number_survives_saving(tmp_path, text):
    mechanism = replace(BENCH, name=text, source=text, assumed={text: text})
    assert reread(mechanism, tmp_path) == mechanism


@settings(max_examples=60)
@given(
    st.text(st.characters(categories=["L", "M", "N", "P", "S"], include_characters=" "), max_size=150),
    st.text(st.characters(exclude_categories=["Cs"]), max_size=300),
)
@example("line ends", "\x85")
@example("line ends", "one\rtwo\u2028three")
@example("null", "~")
@example("true", "no")
@example("- a: *b", "<<")
@example(" #{[\"'", "---\n...\n")
@example("a" * 200, "\0\x85\u2028\ufeff\U0010ffff\r\n")
def test_any_text_survives_saving(tmp_path_factory, name, source):
    assume(name.strip())
    mechanism = replace(read(MECHANISM), name=name, source=source, assumed={"gravity": source, source: name})
    again = reread(mechanism, tmp_path_factory.getbasetemp())
    assert (again.name, again.source, dict(again.assumed)) == (name, source, dict(mechanism.assumed))


def test_a_lone_surrogate_is_refused_or_survives_saving(tmp_path):
    try:
        mechanism = read(edited("name: bench", 'name: bench\nsource: "\\uD800"'))
    except MechanismError:
        return
    assert reread(mechanism, tmp_path) == mechanism


def test_six_different_legs_are_a_list_and_stay_in_order(tmp_path):
    shared = mapping()
    leg = shared["legs"]
    legs = [
        {**leg, "lower": {**leg["lower"], "mass": 0.5 + i}, "length_limits": [0.1 * i, 9]} for i in range(6)
    ]
    mechanism = read(yaml.safe_dump({**shared, "legs": legs}))
    assert_array_equal(mechanism.lower.mass, [0.5, 1.5, 2.5, 3.5, 4.5, 5.5])
    assert_array_equal(mechanism.upper.mass, [0.3] * 6)
    assert_array_equal(mechanism.length_limits[:, 0], [0.1 * i for i in range(6)])
    assert mechanism != BENCH
    assert reread(mechanism, tmp_path) == mechanism
    assert isinstance(mechanism.to_mapping()["legs"], list)


def test_saving_where_nothing_can_be_written_leaves_nothing(tmp_path):
    (tmp_path / "file").write_text("in the way\n")
    for path in (tmp_path / "file" / "m.yaml", tmp_path / "nowhere" / "m.yaml", tmp_path):
        with pytest.raises(OutputError, match="allowed: "):
            BENCH.save(path)
    with pytest.raises(OutputError, match="allowed: "):
        BENCH.save(tmp_path / ("m" * 300))
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_the_bundled_names_are_all_there():
    assert bundled_mechanisms() == sorted([*BUNDLED, "dietmaier1998"])


def test_bundled_mechanisms_tell_source_and_assumed_values(mechanism):
    assert mechanism.source
    assert mechanism.assumed
    content = mechanism.to_mapping()
    for key, reason in mechanism.assumed.items():
        assert reason.strip()
        value = content
        for part in key.split("."):
            value = value[part]


def test_wu2012_marks_what_the_paper_does_not_give(wu2012):
    assumed = set(wu2012.assumed)
    assert assumed == {
        "gravity",
        "base.anchors",
        "platform.anchors",
        "platform.com",
        "platform.inertia",
        "legs",
    }
    assert wu2012.platform.mass == 1.0
    for anchors, radius, degrees in (
        (wu2012.base_anchors, 0.25, [-15, 15, 105, 135, 225, 255]),
        (wu2012.platform_anchors, 0.1, [-45, 45, 75, 165, 195, 285]),
    ):
        angles = np.deg2rad(degrees)
        circle = radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(6)])
        assert_allclose(anchors, circle, rtol=0, atol=1e-15)


def test_an_unknown_name_lists_the_bundled_ones():
    with pytest.raises(MechanismError) as caught:
        Mechanism.load("wu2013")
    assert str(caught.value).startswith("wu2013: mechanism: ")
    for name in BUNDLED:
        assert name in str(caught.value)


def test_defaults_of_com_limits_and_text():
    assert BENCH.legs[0].lower.com == 0.225
    assert BENCH.legs[0].upper.com == 0.2
    assert BENCH.legs[0].length_limits == (0.45, 0.45 + 0.4)
    assert_array_equal(BENCH.platform.com, [0, 0, 0])
    assert_array_equal(BENCH.platform.inertia, np.diag([0.0025, 0.0025, 0.005]))
    assert (BENCH.source, dict(BENCH.assumed)) == ("", {})


def test_com_and_limits_are_taken_as_given():
    text = edited("  mass: 1.25", "  mass: 1.25\n  com: [1e-3, -2e-3, 0]")
    text = edited("length: 0.4,", "length: 0.4, com: 0.15,", text) + "  length_limits: [0.5, 0.7]\n"
    mechanism = read(text)
    assert_array_equal(mechanism.platform.com, [0.001, -0.002, 0])
    assert mechanism.legs[3].upper.com == 0.15
    assert mechanism.legs[3].lower.com == 0.225
    assert_array_equal(mechanism.length_limits, [[0.5, 0.7]] * 6)


def test_products_of_inertia_stand_on_both_sides_of_the_diagonal():
    mechanism = read(edited("zz: 0.005", "zz: 0.004, xy: 1e-4, xz: 2e-4, yz: -3e-4"))
    expected = [[0.0025, 1e-4, 2e-4], [1e-4, 0.0025, -3e-4], [2e-4, -3e-4, 0.004]]
    assert_array_equal(mechanism.platform.inertia, expected)


def test_radius_means_a_solid_cylinder():
    link = read(edited("inertia: {transverse: 0.004, axial: 2e-5}", "radius: 0.012")).legs[0].upper
    assert link.axial == pytest.approx(0.3 * 0.012**2 / 2, rel=1e-15)
    assert link.transverse == pytest.approx(0.3 * (3 * 0.012**2 + 0.4**2) / 12, rel=1e-15)
    assert link.com == 0.2
    assert link == Link.solid_cylinder(0.3, 0.4, 0.012)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-4", 1e-4),
        ("1E+2", 100.0),
        ("+1.5", 1.5),
        (".5", 0.5),
        ("5.", 5.0),
        ("12e03", 12000.0),
        ("010", 10.0),
    ],
)
def test_numbers_are_those_of_yaml_1_2(text, value):
    assert read(edited("1.25", text)).platform.mass == value


@pytest.mark.parametrize(
    "text", ["1:30", "1_000", "0x10", "0b1", "yes", "1,5", "'1'", "1.0 kg", "1e", "~", "true"]
)
def test_what_is_no_number_in_yaml_1_2_is_refused_as_text(text):
    assert "platform.mass" in mechanism_refusal(edited("1.25", text))


def test_on_and_off_are_text():
    assert read(edited("name: bench", "name: on")).name == "on"


def test_aliases_and_merge_keys_are_written_out():
    text = edited("lower: {", "lower: &link {")
    text = text.replace(
        "upper: {mass: 0.3, length: 0.4, inertia: {transverse: 0.004, axial: 2e-5}}", "upper: UPPER"
    )
    assert read(edited("UPPER", "*link", text)).legs[0].upper == read(MECHANISM).legs[0].lower
    merged = read(edited("UPPER", "{<<: *link, mass: 0.3}", text)).legs[0]
    assert merged.upper == replace(merged.lower, mass=0.3)


def test_a_byte_order_mark_and_windows_line_ends_do_not_matter():
    assert read("\ufeff" + MECHANISM.replace("\n", "\r\n")) == BENCH


# what is edited, what to, key that the message names, what else it says
ERRORS = {
    "unknown key": ("name: bench", "name: bench\ncolour: red", "colour", ["red", "gravity"]),
    "unknown key in a link": ("mass: 0.5", "mass: 0.5, weight: 5", "legs.lower.weight", ["5", "radius"]),
    "unknown key in inertia": ("xx: 0.0025", "xx: 0.0025, ww: 1", "platform.inertia.ww", ["1", "xy"]),
    "key with a unit": ("  mass: 1.25", "  mass: 1.25\n  mass [kg]: 1.25", "platform.mass [kg]", ["1.25"]),
    "key called each": ("name: bench", "name: bench\neach: 7", "each", ["7"]),
    "key called shared": ("name: bench", "name: bench\nshared: 7", "shared", ["7"]),
    "key that is a number": ("name: bench", "name: bench\n12: 7", "12", []),
    "repeated key": ("xx: 0.0025", "xx: 0.0025, xx: 0.0025", "platform.inertia.xx", ["repeated"]),
    "name is a number": ("name: bench", "name: 2012", "name", ["2012", "text"]),
    "empty name": ("name: bench", "name: ''", "name", ["printable"]),
    "two gravity components": ("[0, 0, -9.81]", "[0, -9.81]", "gravity", ["2 entries", "3 entries"]),
    "gravity is a number": ("[0, 0, -9.81]", "-9.81", "gravity", ["-9.81", "a list"]),
    "base is a list": ("platform:\n", "platform: []\nleftover:\n", "platform", ["[]", "mapping"]),
    "anchor with two coordinates": ("[0.24, 0.06, 0]", "[0.24, 0.06]", "base.anchors.1", ["2 entries"]),
    "anchor with text": ("[0.24, 0.06, 0]", "[0.24, here, 0]", "base.anchors.1.1", ["here", "number"]),
    "capital NaN": ("1.25", ".NaN", "platform.mass", ["nan", "finite"]),
    "capital infinity": ("1.25", "-.Inf", "platform.mass", ["-inf", "finite"]),
    "shouted infinity": ("1.25", ".INF", "platform.mass", ["inf", "finite"]),
    "more than a float holds": ("1.25", "1e999", "platform.mass", ["inf", "finite"]),
    "negative length": ("length: 0.4,", "length: -0.4,", "legs.upper.length", ["-0.4", "> 0", "m"]),
    "zero transverse": ("transverse: 0.004", "transverse: 0", "legs.upper.inertia.transverse", ["0", "> 0"]),
    "negative axial": ("axial: 2e-5", "axial: -2e-5", "legs.upper.inertia.axial", ["-2e-05", "> 0"]),
    "axial above twice transverse": (
        "axial: 2e-5", "axial: 0.0081", "legs.upper.inertia.axial", ["0.0081", "0.008"],
    ),
    "radius beside inertia": ("length: 0.4,", "length: 0.4, radius: 0.1,", "legs.upper", ["both", "one"]),
    "neither radius nor inertia": (
        ", inertia: {transverse: 0.004, axial: 2e-5}", "", "legs.upper", ["neither", "one"],
    ),
    "zero radius": (
        "inertia: {transverse: 0.004, axial: 2e-5}", "radius: 0", "legs.upper.radius", ["0", "> 0"],
    ),
    "huge radius": ("inertia: {transverse: 0.004, axial: 2e-5}", "radius: 1e200", "legs.upper", ["1e+200"]),
    "limits backwards": ("legs:", "legs:\n  length_limits: [0.9, 0.5]", "legs.length_limits", ["[0.9, 0.5]"]),
    "negative limit": ("legs:", "legs:\n  length_limits: [-1, 0.5]", "legs.length_limits", ["[-1.0, 0.5]"]),
    "three limits": ("legs:", "legs:\n  length_limits: [1, 2, 3]", "legs.length_limits", ["3 entries"]),
    "assumed is a list": ("name: bench", "name: bench\nassumed: [gravity]", "assumed", ["mapping"]),
    "assumed without text": (
        "name: bench", "name: bench\nassumed: {gravity: 9.81}", "assumed.gravity", ["9.81", "text"],
    ),
}  # fmt: skip


@pytest.mark.parametrize(("old", "new", "key", "says"), ERRORS.values(), ids=ERRORS)
def test_an_error_names_file_line_key_value_and_what_is_allowed(old, new, key, says):
    text = edited(old, new)
    message = mechanism_refusal(text)
    changed, _ = next(
        (number, pair)
        for number, pair in enumerate(zip(text.splitlines(), MECHANISM.splitlines(), strict=False), 1)
        if pair[0] != pair[1]
    )
    assert message.startswith(f"bench.yaml:{changed}: {key}"), message
    for words in says:
        assert words in message


@pytest.mark.parametrize(
    "key", ["gravity", "platform.mass", "platform.inertia.zz", "legs.lower.length", "legs"]
)
def test_a_missing_key_is_named(key):
    content = mapping()
    *parents, last = key.split(".")
    section = content
    for parent in parents:
        section = section[parent]
    del section[last]
    message = mechanism_refusal(yaml.safe_dump(content))
    assert f"{key}: missing; allowed: this key is required" in message


def test_seven_anchors_are_refused():
    message = mechanism_refusal(edited("base:\n  anchors:\n", "base:\n  anchors:\n    - [1, 2, 3]\n"))
    assert message == "bench.yaml:4: base.anchors: 7 entries; allowed: 6 entries"


@pytest.mark.parametrize("count", [0, 1, 5, 7])
def test_a_list_of_legs_has_six(count):
    content = mapping()
    text = yaml.safe_dump({**content, "legs": [content["legs"]] * count})
    expected = f"bench.yaml:{line_of('legs:', text)}: legs: {count} entries; allowed: 6 entries"
    assert mechanism_refusal(text) == expected


def test_the_leg_at_fault_is_named():
    content = mapping()
    bad = {**content["legs"], "upper": {**content["legs"]["upper"], "mass": -3}}
    text = yaml.safe_dump({**content, "legs": [content["legs"]] * 4 + [bad, content["legs"]]})
    expected = f"bench.yaml:{line_of('mass: -3', text)}: legs.4.upper.mass: -3.0; "
    assert mechanism_refusal(text).startswith(expected)


def test_a_base_similar_to_the_platform_is_refused():
    base = MECHANISM[MECHANISM.index("    - [0.24") : MECHANISM.index("platform:")]
    platform = MECHANISM[MECHANISM.index("    - [0.07") : MECHANISM.index("  mass: 1.25")]
    message = mechanism_refusal(edited(platform, base))
    assert "every pose is singular" in message
    assert "anchors" in message
    assert message.removeprefix("bench.yaml:")[0].isdigit(), message


def test_anchors_on_one_line_are_refused():
    platform = MECHANISM[MECHANISM.index("    - [0.07") : MECHANISM.index("  mass: 1.25")]
    row = "".join(f"    - [{0.1 * i}, 0, 0]\n" for i in range(1, 7))
    assert "every pose is singular" in mechanism_refusal(edited(platform, row))
