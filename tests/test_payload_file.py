"""Payload files: read exactly, and refused in one line that names file, line, key and what is allowed."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from texts import damaged, edited, line_of

import sixsps
from sixsps.errors import MechanismError
from sixsps.payload import Payload
from sixsps.payload_file import parse

TOOL = """\
# a gripper
mass: 2.5
com: [0.01, -0.02, 0.08]
inertia: {xx: 0.004, yy: 0.005, zz: 0.003, xy: 1e-4, xz: -2e-4, yz: 3e-4}
"""
INERTIA = [[0.004, 1e-4, -2e-4], [1e-4, 0.005, 3e-4], [-2e-4, 3e-4, 0.003]]


def refusal(text):
    with pytest.raises(MechanismError) as caught:
        parse(text if isinstance(text, bytes) else text.encode(), "tool.yaml")
    message = str(caught.value)
    assert message.isprintable(), message
    assert "; allowed: " in message, message
    return message


def test_file_is_read_to_the_last_bit(tmp_path):
    path = tmp_path / "tool.yaml"
    path.write_text(TOOL)
    payload = Payload.load(path)
    assert (payload.name, payload.mass) == ("tool", 2.5)
    assert_array_equal(payload.com, [0.01, -0.02, 0.08])
    assert_array_equal(payload.inertia, INERTIA)
    for array in (payload.com, payload.inertia):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_com_is_the_platforms_origin_by_default():
    text = "".join(line for line in TOOL.splitlines(keepends=True) if not line.startswith("com"))
    assert_array_equal(parse(text.encode(), "tool.yaml").com, np.zeros(3))


def test_section_of_a_mechanism_file_means_the_same():
    mechanism = sixsps.Mechanism.load("wu2012")
    section = mechanism.to_mapping()["platform"]
    text = f"mass: {section['mass']}\ncom: {section['com']}\ninertia: {section['inertia']}".replace("'", "")
    payload = parse(text.encode(), "platform.yaml")
    assert payload.mass == mechanism.platform.mass
    assert_array_equal(payload.com, mechanism.platform.com)
    assert_array_equal(payload.inertia, mechanism.platform.inertia)


@pytest.mark.parametrize(
    "inertia", [np.zeros((3, 3)), np.diag([1.0, 1.0, 0.0]), np.diag([1.0, 1.0, 2.0])], ids=str
)
def test_points_rods_and_plates_are_bodies(inertia):
    assert_array_equal(Payload(1.0, np.zeros(3), inertia).inertia, inertia)


REFUSED = [
    ("mass: 2.5", "mass: 0", "mass: 0.0; allowed: finite and > 0 [kg]"),
    ("mass: 2.5", "mass: -1", "mass: -1.0; allowed: finite and > 0 [kg]"),
    ("mass: 2.5", "mass: heavy", "mass: 'heavy'; allowed: a number"),
    ("mass: 2.5", "mass: .nan", "mass: nan; allowed: a finite number"),
    ("mass: 2.5", "mass: 1e51", "mass: 1e+51; allowed: finite numbers up to 1e+50"),
    ("mass: 2.5", "weight: 2.5", "mass: missing; allowed: this key is required"),
    ("mass: 2.5", "mass: 2.5\nanchors: 1", "anchors: 1.0; allowed: the keys mass, com, inertia"),
    ("mass: 2.5", "mass: 2.5\nmass: 2.5", "mass: repeated key; allowed: each key once"),
    ("0.08]", "0.08, 1]", "com: 4 entries; allowed: 3 entries"),
    ("0.08]", "1e60]", "com[2]: 1e+60; allowed: finite numbers up to 1e+50"),
    ("yz: 3e-4", "zy: 3e-4", "inertia.zy: 0.0003; allowed: the keys xx, yy, zz, xy, xz, yz"),
    ("xx: 0.004, ", "", "inertia.xx: missing; allowed: this key is required"),
    ("xx: 0.004", "xx: 0.04", "no principal moment larger than the sum of the other two"),
    ("xx: 0.004", "xx: -0.004", "no negative principal moment [kg m^2]"),
]


@pytest.mark.parametrize(("old", "new", "said"), REFUSED)
def test_what_no_payload_can_be_is_refused_with_its_line(old, new, said):
    text = edited(old, new, TOOL)
    message = refusal(text)
    assert said in message
    if "missing" not in said or "inertia" in said:
        key = said.split(":")[0].split(".")[0].split("[")[0]
        number = line_of("inertia" if "principal" in said else key, text)
        number += "repeated" in said
        assert message.startswith(f"tool.yaml:{number}: "), message


@pytest.mark.parametrize(
    "text", ["", "[1, 2]", "mass", b"\xff\xfe", "mass: !!python/object:os.system 1", "a: &a [*a]"]
)
def test_what_is_no_mapping_is_refused(text):
    assert refusal(text).startswith("tool.yaml")


def test_file_that_is_not_there(tmp_path):
    with pytest.raises(MechanismError, match="payload: no such file; allowed: an existing file"):
        Payload.load(tmp_path / "none.yaml")


@pytest.mark.parametrize("inertia", [np.eye(2), np.triu(np.ones((3, 3))), np.full((3, 3), np.nan)], ids=str)
def test_matrices_that_are_no_inertia(inertia):
    with pytest.raises(MechanismError, match="inertia"):
        Payload(1.0, np.zeros(3), inertia)


def test_damaged_files_are_read_or_refused_in_one_line():
    for content in damaged(TOOL.encode(), 300):
        try:
            payload, message = parse(content, "tool.yaml"), ""
        except MechanismError as error:
            payload, message = None, str(error)
        assert payload is None or payload.mass > 0
        assert payload or (message.isprintable() and message.startswith("tool.yaml"))
