"""Broken and hostile mechanism files: refused in one line, at once, and harmless as files and as names."""

import time
import tracemalloc
import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest
from texts import BENCH, MECHANISM, edited, line_of, mechanism_refusal

from sixsps.errors import MechanismError, OutputError
from sixsps.mechanism import Mechanism
from urdf.export import export_mjcf, export_urdf
from urdf.mjcf import render_mjcf
from urdf.render import render_urdf


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
        MECHANISM.encode("utf-16"),
        b"name: \x07",
        b"name: \xe9",
        'name: "\\UFFFFFFFF"',
        'name: "\\U00110000"',
        'name: "\\x"',
    ],
)
def test_what_is_no_mapping_in_yaml_is_refused(text):
    mechanism_refusal(text)


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
    message = mechanism_refusal(text)
    assert str(line_of("mass: !", text)) in message
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "key", ['"two\\nlines"', '"\\e[31mred"', '"\\0"', '"\\uD800"', "? long" + "g" * 5000 + "\n"]
)
def test_a_strange_key_gives_one_printable_line(key):
    mechanism_refusal(MECHANISM + f"{key}: 1\n")


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
    seconds, peak = seconds_and_peak(lambda: mechanism_refusal(text + MECHANISM))
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
    assert "itself" in mechanism_refusal(text)


@pytest.mark.parametrize("opening", ["[", "{a: ", "- ", "? ", "[{a: "])
def test_deep_nesting_is_refused(opening):
    text = MECHANISM + "deep:\n  " + opening * (200_000 // len(opening))
    begin = time.process_time()
    mechanism_refusal(text)
    assert time.process_time() - begin < 5


@pytest.mark.parametrize("depth", [50, 150, 300, 450, 600])
def test_nesting_that_closes_is_refused_at_any_depth(depth):
    mechanism_refusal(MECHANISM + "deep: " + "[" * depth + "]" * depth + "\n")
    mechanism_refusal(edited("1.25", "[" * depth + "]" * depth))


@pytest.mark.parametrize("name", ["m" * 300, "m" * 300 + ".yaml", "../" * 2000, "a\0b", "two\nlines.yaml"])
def test_an_impossible_path_is_refused_in_one_line(name):
    with pytest.raises(MechanismError) as caught:
        Mechanism.load(name)
    assert str(caught.value).isprintable()


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
def test_a_hostile_name_is_only_text_and_stays_in_the_output_folder(tmp_path, monkeypatch, name):
    place = tmp_path / "a" / "b" / "here"
    place.mkdir(parents=True)
    monkeypatch.chdir(place)
    saved = tmp_path / "again.yaml"
    replace(BENCH, name=name).save(saved)
    mechanism = Mechanism.load(saved)
    assert mechanism.name == name
    saved.unlink()
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
def test_a_name_changes_nothing_else_in_the_descriptions(name):
    mechanism = replace(BENCH, name=name)
    for render, attribute in ((render_urdf, "name"), (render_mjcf, "model")):
        plain, other = (ET.fromstring(render(which)) for which in (BENCH, mechanism))
        other.set(attribute, plain.get(attribute))
        assert ET.tostring(plain) == ET.tostring(other)


@pytest.mark.parametrize(
    "name", ["", "  ", "a\nb", "\0", "\x1b[31m", "\u202e", "\ud800", "\ufeff", "x" * 201]
)
def test_a_name_with_control_characters_or_without_end_is_refused(name):
    with pytest.raises(MechanismError, match="name: ") as caught:
        replace(BENCH, name=name)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("export", [export_urdf, export_mjcf])
def test_a_mechanism_s_name_cannot_overwrite_files_outside(tmp_path, export):
    victim = tmp_path / "victim.xml"
    victim.write_text("mine\n")
    export(replace(BENCH, name="../victim"), tmp_path / "out")
    assert victim.read_text() == "mine\n"


def test_an_export_that_fails_half_way_leaves_nothing(tmp_path):
    (tmp_path / "bench.xml").mkdir()
    with pytest.raises(OutputError, match=r"bench\.xml"):
        export_urdf(BENCH, tmp_path / "bench.urdf")
    assert [path.name for path in tmp_path.iterdir()] == ["bench.xml"]
