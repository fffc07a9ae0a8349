"""Mechanism files and the mechanism itself: exact, validated, and harmless whatever they hold."""

import math
import time
import tracemalloc
import xml.etree.ElementTree as ET
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
import yaml
from cases import BUNDLED, random_mechanism
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from sixsps.errors import MechanismError, OutputError
from sixsps.mechanism import Leg, Link, Mechanism, Platform
from sixsps.mechanism_file import bundled_mechanisms, parse
from urdf.export import export_mjcf, export_urdf
from urdf.mjcf import render_mjcf
from urdf.render import render_urdf

TEXT = """\
name: bench
gravity: [0, 0, -9.81]
base:
  anchors:
    - [0.24, -0.06, 0]
    - [0.24, 0.06, 0]
    - [-0.06, 0.24, 0]
    - [-0.18, 0.18, 0]
    - [-0.18, -0.18, 0]
    - [-0.06, -0.24, 0]
platform:
  anchors:
    - [0.07, -0.07, 0]
    - [0.07, 0.07, 0]
    - [0.03, 0.1, 0]
    - [-0.1, 0.03, 0]
    - [-0.1, -0.03, 0]
    - [0.03, -0.1, 0]
  mass: 1.25
  inertia: {xx: 0.0025, yy: 0.0025, zz: 0.005}
legs:
  lower: {mass: 0.5, length: 0.45, inertia: {transverse: 0.008, axial: 1e-4}}
  upper: {mass: 0.3, length: 0.4, inertia: {transverse: 0.004, axial: 2e-5}}
"""
LINK = Link(mass=0.5, length=0.45, com=0.2, transverse=0.008, axial=1e-4)
LEG = Leg(LINK, LINK)
INERTIA = np.diag([0.0025, 0.0025, 0.005])
ARRAYS = ("gravity", "base_anchors", "platform_anchors")
FIELDS = ("mass", "length", "com", "transverse", "axial")


def edited(old, new, text=TEXT):
    assert text.count(old) == 1, old
    return text.replace(old, new)


def read(text):
    return parse(text if isinstance(text, bytes) else text.encode(), "bench.yaml")


def mapping():
    """The bench as plain data; YAML 1.1 would read 1e-4 as text."""
    return yaml.safe_load(edited("1e-4", "1.0e-4").replace("2e-5", "2.0e-5"))


def refusal(text):
    """Returns the message with which `text` is refused, one printable line that names the file."""
    with pytest.raises(MechanismError) as caught:
        read(text)
    message = str(caught.value)
    assert message.isprintable()
    assert message.startswith("bench.yaml:")
    assert "; allowed: " in message
    return message


def line_of(words, text):
    return next(number for number, line in enumerate(text.splitlines(), 1) if words in line)


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


@pytest.fixture(scope="module")
def bench():
    return read(TEXT)


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
    leg = Leg(Link(mass, length, -com, transverse, transverse), LINK, (0.0, length))
    mechanism = replace(read(TEXT), gravity=[-0.0, com, -mass], legs=[leg] * 6)
    assert bits(reread(mechanism, tmp_path_factory.getbasetemp())) == bits(mechanism)


# Plain text for YAML 1.1, which PyYAML writes, and a number for YAML 1.2, which is read.
@pytest.mark.parametrize("text", ["1e5", "1.5e5", "08", "-.5"])
def test_text_that_looks_like_a_number_survives_saving(bench, tmp_path, text):
    mechanism = replace(bench, name=text, source=text, assumed={text: text})
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
    mechanism = replace(read(TEXT), name=name, source=source, assumed={"gravity": source, source: name})
    again = reread(mechanism, tmp_path_factory.getbasetemp())
    assert (again.name, again.source, dict(again.assumed)) == (name, source, dict(mechanism.assumed))


def test_a_lone_surrogate_is_refused_or_survives_saving(tmp_path):
    try:
        mechanism = read(edited("name: bench", 'name: bench\nsource: "\\uD800"'))
    except MechanismError:
        return
    assert reread(mechanism, tmp_path) == mechanism


def test_six_different_legs_are_a_list_and_stay_in_order(bench, tmp_path):
    shared = mapping()
    leg = shared["legs"]
    legs = [
        {**leg, "lower": {**leg["lower"], "mass": 0.5 + i}, "length_limits": [0.1 * i, 9]} for i in range(6)
    ]
    mechanism = read(yaml.safe_dump({**shared, "legs": legs}))
    assert_array_equal(mechanism.lower.mass, [0.5, 1.5, 2.5, 3.5, 4.5, 5.5])
    assert_array_equal(mechanism.upper.mass, [0.3] * 6)
    assert_array_equal(mechanism.length_limits[:, 0], [0.1 * i for i in range(6)])
    assert mechanism != bench
    assert reread(mechanism, tmp_path) == mechanism
    assert isinstance(mechanism.to_mapping()["legs"], list)


def test_saving_where_nothing_can_be_written_leaves_nothing(bench, tmp_path):
    (tmp_path / "file").write_text("in the way\n")
    for path in (tmp_path / "file" / "m.yaml", tmp_path / "nowhere" / "m.yaml", tmp_path):
        with pytest.raises(OutputError, match="allowed: "):
            bench.save(path)
    with pytest.raises(OutputError, match="allowed: "):
        bench.save(tmp_path / ("m" * 300))
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_the_bundled_names_are_all_there():
    assert bundled_mechanisms() == sorted(BUNDLED)


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


@pytest.mark.parametrize("name", ["m" * 300, "m" * 300 + ".yaml", "../" * 2000, "a\0b", "two\nlines.yaml"])
def test_an_impossible_path_is_refused_in_one_line(name):
    with pytest.raises(MechanismError) as caught:
        Mechanism.load(name)
    assert str(caught.value).isprintable()


def test_defaults_of_com_limits_and_text(bench):
    assert bench.legs[0].lower.com == 0.225
    assert bench.legs[0].upper.com == 0.2
    assert bench.legs[0].length_limits == (0.45, 0.45 + 0.4)
    assert_array_equal(bench.platform.com, [0, 0, 0])
    assert_array_equal(bench.platform.inertia, INERTIA)
    assert (bench.source, dict(bench.assumed)) == ("", {})


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
    assert "platform.mass" in refusal(edited("1.25", text))


def test_on_and_off_are_text():
    assert read(edited("name: bench", "name: on")).name == "on"


def test_aliases_and_merge_keys_are_written_out():
    text = edited("lower: {", "lower: &link {")
    text = text.replace(
        "upper: {mass: 0.3, length: 0.4, inertia: {transverse: 0.004, axial: 2e-5}}", "upper: UPPER"
    )
    assert read(edited("UPPER", "*link", text)).legs[0].upper == read(TEXT).legs[0].lower
    merged = read(edited("UPPER", "{<<: *link, mass: 0.3}", text)).legs[0]
    assert merged.upper == replace(merged.lower, mass=0.3)


def test_a_byte_order_mark_and_windows_line_ends_do_not_matter(bench):
    assert read("\ufeff" + TEXT.replace("\n", "\r\n")) == bench


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
    message = refusal(text)
    changed, _ = next(
        (number, pair)
        for number, pair in enumerate(zip(text.splitlines(), TEXT.splitlines(), strict=False), 1)
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
    message = refusal(yaml.safe_dump(content))
    assert f"{key}: missing; allowed: this key is required" in message


def test_seven_anchors_are_refused():
    message = refusal(edited("base:\n  anchors:\n", "base:\n  anchors:\n    - [1, 2, 3]\n"))
    assert message == "bench.yaml:4: base.anchors: 7 entries; allowed: 6 entries"


@pytest.mark.parametrize("count", [0, 1, 5, 7])
def test_a_list_of_legs_has_six(count):
    content = mapping()
    text = yaml.safe_dump({**content, "legs": [content["legs"]] * count})
    assert refusal(text) == f"bench.yaml:{line_of('legs:', text)}: legs: {count} entries; allowed: 6 entries"


def test_the_leg_at_fault_is_named():
    content = mapping()
    bad = {**content["legs"], "upper": {**content["legs"]["upper"], "mass": -3}}
    text = yaml.safe_dump({**content, "legs": [content["legs"]] * 4 + [bad, content["legs"]]})
    assert refusal(text).startswith(f"bench.yaml:{line_of('mass: -3', text)}: legs.4.upper.mass: -3.0; ")


def test_a_thin_plate_is_a_rigid_body():
    angle = 0.3
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    tilt = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    turned = turn @ tilt @ np.diag([1.0, 2.0, 3.0]) @ tilt.T @ turn.T
    for inertia in (np.diag([1.0, 2.0, 3.0]), (turned + turned.T) / 2):
        assert_array_equal(Platform(1.0, [0, 0, 0], inertia).inertia, inertia)


def test_a_base_similar_to_the_platform_is_refused():
    base = TEXT[TEXT.index("    - [0.24") : TEXT.index("platform:")]
    platform = TEXT[TEXT.index("    - [0.07") : TEXT.index("  mass: 1.25")]
    message = refusal(edited(platform, base))
    assert "every pose is singular" in message
    assert "anchors" in message
    assert message.removeprefix("bench.yaml:")[0].isdigit(), message


def test_anchors_on_one_line_are_refused():
    platform = TEXT[TEXT.index("    - [0.07") : TEXT.index("  mass: 1.25")]
    row = "".join(f"    - [{0.1 * i}, 0, 0]\n" for i in range(1, 7))
    assert "every pose is singular" in refusal(edited(platform, row))


@pytest.mark.parametrize("group", ["base", "platform"])
def test_pairs_of_coincident_anchors_are_a_real_mechanism(bench, group):
    anchors = np.array(getattr(bench, f"{group}_anchors"))
    anchors[1::2] = anchors[::2]
    assert replace(bench, **{f"{group}_anchors": anchors}).name == "bench"


@pytest.mark.parametrize(
    "text",
    [
        "[1, 2]",
        "hello",
        "# nothing",
        "---\n",
        "name: bench\n\t- tab",
        "name: 'open",
        "a: b: c",
        "*nowhere",
        "%YAML 9.0\n---\nname: bench",
        "? [1, 2]\n: 3",
        "name: bench\n---\nname: bench",
        b"\x00\x01\x02",
        b"\xff\xfe\x00n",
        TEXT.encode("utf-16"),
        b"name: \x07",
        b"name: \xe9",
        'name: "\\UFFFFFFFF"',
        'name: "\\U00110000"',
        'name: "\\x"',
    ],
)
def test_what_is_no_mapping_in_yaml_is_refused(text):
    refusal(text)


TAGS = [
    "!!python/object/apply:os.system ['touch pwned']",
    "!!python/object/new:os.system ['touch pwned']",
    "!!python/name:os.system",
    "!!python/module:os",
    "!!python/tuple [1]",
    "!custom 1",
    "!!float abc",
    "!!float ''",
    "!!int abc",
    "!!int ''",
    "!!bool maybe",
    "!!timestamp abc",
    "!!timestamp 2001-99-99",
    "!!binary x",
    "!!set {1}",
    "!!omap [1: 2]",
    "!!map 1",
    "!!seq 1",
]


@pytest.mark.parametrize("tag", TAGS)
def test_a_tag_executes_nothing_and_is_refused_with_its_line(tmp_path, monkeypatch, tag):
    monkeypatch.chdir(tmp_path)
    text = edited("1.25", tag)
    message = refusal(text)
    assert str(line_of("mass: !", text)) in message
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "key", ['"two\\nlines"', '"\\e[31mred"', '"\\0"', '"\\uD800"', "? long" + "g" * 5000 + "\n"]
)
def test_a_strange_key_gives_one_printable_line(key):
    refusal(TEXT + f"{key}: 1\n")


def seconds_and_peak(function):
    """Returns processor time [s] and peak memory [bytes] of a call."""
    begin = time.process_time()
    function()
    seconds = time.process_time() - begin
    tracemalloc.start()
    function()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return seconds, peak


def bomb(width=9, depth=12):
    """A kilobyte that is width ** depth entries once its aliases are written out."""
    lines = ["a0: &a0 [x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * width)}]" for i in range(1, depth)]
    return "\n".join(lines) + "\n"


def merge_bomb():
    lines = ["a0: &a0 {k: 1}"]
    lines += [f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 9)}]}}" for i in range(1, 12)]
    return "\n".join(lines) + "\n"


def key_bomb():
    return bomb() + "? *a11\n: 1\n"


@pytest.mark.parametrize(
    "text", [bomb(), bomb(2, 400), merge_bomb(), key_bomb()], ids=["9", "2", "merge", "key"]
)
def test_aliases_that_expand_exponentially_are_refused_at_once(text):
    seconds, peak = seconds_and_peak(lambda: refusal(text + TEXT))
    assert seconds < 1
    assert peak < 20e6


def test_a_file_of_100_megabytes_is_refused_unread(tmp_path):
    path = tmp_path / "bomb.yaml"
    path.write_bytes(b"- [1, 2, 3, 4, 5, 6]\n" * 5_000_000)

    def load():
        with pytest.raises(
            MechanismError, match=r"bomb\.yaml: mechanism: more than .* allowed: at most .* bytes"
        ):
            Mechanism.load(path)

    seconds, peak = seconds_and_peak(load)
    path.unlink()
    assert seconds < 1
    assert peak < 2e6


@pytest.mark.parametrize(
    "text",
    ["&a [*a]\n", "name: &a {b: *a}\n", "name: &a [[[*a]]]\n", "a: &a {<<: *a}\n", "? &a [*a]\n: 1\n"],
)
def test_an_alias_that_contains_itself_is_refused(text):
    assert "itself" in refusal(text)


@pytest.mark.parametrize("opening", ["[", "{a: ", "- ", "? ", "[{a: "])
def test_deep_nesting_is_refused(opening):
    text = TEXT + "deep:\n  " + opening * (200_000 // len(opening))
    begin = time.process_time()
    refusal(text)
    assert time.process_time() - begin < 5


@pytest.mark.parametrize("depth", [50, 150, 300, 450, 600])
def test_nesting_that_closes_is_refused_at_any_depth(depth):
    refusal(TEXT + "deep: " + "[" * depth + "]" * depth + "\n")
    refusal(edited("1.25", "[" * depth + "]" * depth))


NAMES = [
    "../../pwned",
    "/etc/pwned",
    "..",
    ".",
    "-rf",
    "~root",
    "CON",
    "${__import__('os').system('touch pwned')}",
    "${1/0}",
    "$(find pwned)",
    "$(arg home)",
    "$(eval 1+1)",
    "$${x}",
    "`touch pwned`; touch pwned",
    "<script>alert(1)</script>",
    "]]><!-- &amp; &#0; <!ENTITY x SYSTEM 'file:///etc/passwd'>",
    "quote \" and ' and \\",
    "a.b.yaml",
    "Bühne 六足 🤖",
    " blanks around  and within ",
    "%s {0} %(x)s",
    "x" * 200,
]


@pytest.mark.parametrize("name", NAMES)
def test_a_hostile_name_is_only_text_and_stays_in_the_output_folder(bench, tmp_path, monkeypatch, name):
    place = tmp_path / "a" / "b" / "here"
    place.mkdir(parents=True)
    monkeypatch.chdir(place)
    mechanism = reread(replace(bench, name=name), tmp_path)
    assert mechanism.name == name
    (tmp_path / "again.yaml").unlink()
    written = export_urdf(mechanism, place / "out")
    assert sorted(path.suffix for path in written) == [".urdf", ".xml", ".yaml"]
    assert {path for path in tmp_path.rglob("*") if path.is_file()} == set(written)
    assert {path.parent for path in written} == {place / "out"}
    for path in written:
        assert path.name.strip("-._") != ""
        assert path.name.isascii()
    robot = ET.parse(next(path for path in written if path.suffix == ".urdf")).getroot()
    model = ET.parse(next(path for path in written if path.suffix == ".xml")).getroot()
    assert (robot.tag, robot.get("name")) == ("robot", name)
    assert (model.tag, model.get("model")) == ("mujoco", name)


@pytest.mark.parametrize("name", NAMES)
def test_a_name_changes_nothing_else_in_the_descriptions(bench, name):
    mechanism = replace(bench, name=name)
    for render, attribute in ((render_urdf, "name"), (render_mjcf, "model")):
        plain, other = (ET.fromstring(render(which)) for which in (bench, mechanism))
        other.set(attribute, plain.get(attribute))
        assert ET.tostring(plain) == ET.tostring(other)


@pytest.mark.parametrize(
    "name", ["", "  ", "a\nb", "\0", "\x1b[31m", "\u202e", "\ud800", "\ufeff", "x" * 201]
)
def test_a_name_with_control_characters_or_without_end_is_refused(bench, name):
    with pytest.raises(MechanismError, match="name: ") as caught:
        replace(bench, name=name)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("export", [export_urdf, export_mjcf])
def test_a_mechanism_s_name_cannot_overwrite_files_outside(bench, tmp_path, export):
    victim = tmp_path / "victim.xml"
    victim.write_text("mine\n")
    export(replace(bench, name="../victim"), tmp_path / "out")
    assert victim.read_text() == "mine\n"


def test_an_export_that_fails_half_way_leaves_nothing(bench, tmp_path):
    (tmp_path / "bench.xml").mkdir()
    with pytest.raises(OutputError, match=r"bench\.xml"):
        export_urdf(bench, tmp_path / "bench.urdf")
    assert [path.name for path in tmp_path.iterdir()] == ["bench.xml"]


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
def test_a_mechanism_refuses_what_no_hexapod_has(bench, changes, says):
    with pytest.raises(MechanismError) as caught:
        replace(bench, **changes)
    assert says in str(caught.value)


def test_no_array_of_a_mechanism_can_be_written(bench):
    arrays = [getattr(bench, name) for name in ARRAYS]
    arrays += [bench.platform.com, bench.platform.inertia, bench.length_limits]
    arrays += [getattr(links, name) for links in (bench.lower, bench.upper) for name in FIELDS]
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


def test_no_attribute_of_a_mechanism_can_be_set(bench):
    for thing, name in (
        (bench, "gravity"),
        (bench, "name"),
        (bench.platform, "mass"),
        (bench.legs[0], "lower"),
        (bench.legs[0].lower, "mass"),
    ):
        with pytest.raises(FrozenInstanceError):
            setattr(thing, name, getattr(thing, name))


def test_arrays_given_to_a_mechanism_are_copied(bench):
    anchors = np.array(bench.base_anchors)
    mechanism = replace(bench, base_anchors=anchors)
    anchors[0, 0] = 7
    assert mechanism.base_anchors[0, 0] == 0.24
    assert mechanism == bench


def test_mechanisms_differ_by_any_number_and_by_name(bench):
    assert replace(bench, gravity=[0, 0, -9.80665]) != bench
    assert replace(bench, name="other") != bench
    assert replace(bench, name="other").sha256 != bench.sha256
    assert bench != "bench"
