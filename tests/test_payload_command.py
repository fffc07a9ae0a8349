"""`sixsps compare` and `sixsps forces` with a payload, and what they refuse."""

import importlib.util
import json
import sys
from dataclasses import replace

import numpy as np
import pyarrow.csv
import pytest
from texts import put

import sixsps
from compare import cli
from compare.comparison import compare
from compare.payload import catalogue
from compare.payload.cargo import open_cargo
from compare.payload.catalogue import find_robot, robots
from sixsps.errors import MechanismError, UnknownNameError
from sixsps.payload import Payload, attached, shifted_wrench
from sixsps.trajectories import bundled

TOOL = "mass: 3.0\ncom: [0.02, -0.01, 0.15]\ninertia: {xx: 0.02, yy: 0.03, zz: 0.015, xy: 0.001}\n"
PINOCCHIO = pytest.mark.skipif(not robots(), reason="pin and its robots have no wheel for this platform")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tool.yaml").write_text(TOOL)
    return tmp_path


def command(*arguments):
    """Exit status of a command line, in this process."""
    return cli._status(lambda: cli.app([str(argument) for argument in arguments], standalone_mode=False))


def forces_in(path):
    table = pyarrow.csv.read_csv(path).to_pydict()
    return np.column_stack([table[f"f{leg}"] for leg in range(1, 7)])


def joint_motion(folder, time, names):
    waves = {name: np.sin(time + number) for number, name in enumerate(names)}
    rates = {f"d{name}": np.cos(time + number) for number, name in enumerate(names)}
    changes = {f"dd{name}": -np.sin(time + number) for number, name in enumerate(names)}
    return put(folder, {"t": time} | waves | rates | changes)


class TestRigid:
    @pytest.mark.parametrize("engine", ["kane", "fast"])
    def test_forces_are_those_of_the_attached_mechanism(self, folder, engine):
        options = ("--samples", 40, "--payload", "tool.yaml", "--engine", engine)
        assert command("forces", "tsai2000", "line", *options, "--output", "f.csv") == 0
        mechanism = sixsps.Mechanism.load("tsai2000")
        carrying = attached(mechanism, Payload.load("tool.yaml"))
        motion = bundled("line", mechanism, 40)
        shifted = shifted_wrench(motion, mechanism.platform.com, carrying.platform.com)
        wanted = sixsps.inverse_dynamics(carrying, shifted)
        np.testing.assert_allclose(forces_in("f.csv"), wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())

    def test_streamed_file_is_shifted_block_by_block(self, folder, monkeypatch):
        from compare import inputs

        mechanism = sixsps.Mechanism.load("wu2012")
        rng = np.random.default_rng(1)
        motion = replace(bundled("sinusoids", mechanism, 500), force=rng.standard_normal((500, 3)))
        motion.save("motion.csv")
        options = ("--payload", "tool.yaml", "--engine", "fast", "--output")
        assert command("forces", "wu2012", "motion.csv", *options, "whole.csv") == 0
        monkeypatch.setattr(inputs, "_LONG", 100)
        assert command("forces", "wu2012", "motion.csv", *options, "streamed.csv") == 0
        assert (folder / "streamed.csv").read_bytes() == (folder / "whole.csv").read_bytes()

    def test_comparison_says_what_is_aboard(self, folder, capfd):
        arguments = ("--samples", 20, "--payload", "tool.yaml", "--engine", "kane", "--engine", "mujoco")
        assert command("compare", "wu2012", "sinusoids", *arguments) == 0
        assert "payload: tool, 3 kg, a rigid body that is part of the platform" in capfd.readouterr().out
        results = json.loads((folder / "report" / "results.json").read_text())
        assert results["payload"]["mass_kg"] == 3
        assert results["mechanism"]["sha256"] == sixsps.Mechanism.load("wu2012").sha256
        report = (folder / "report" / "report.md").read_text()
        assert report.startswith("# Leg forces of wu2012 along sinusoids with tool aboard\n")
        assert "## Payload\n\nThe payload and the platform are one rigid body" in report
        assert "- Payload `tool`, 3 kg, a rigid body, SHA-256" in report

    def test_names_of_files_are_shown_as_they_are(self, folder):
        (folder / "new\nline\x1b[31m`.yaml").write_text(TOOL)
        arguments = ("--samples", 5, "--payload", "new\nline\x1b[31m`.yaml", "--engine", "kane")
        assert command("compare", "wu2012", "line", *arguments) == 0
        report = (folder / "report" / "report.md").read_text()
        assert "- Payload `new\\nline\\x1b[31m'`, 3 kg" in report
        assert "with new\\\\nline\\\\x1b\\[31m\\` aboard\n" in report  # backslashes of Markdown
        assert "\x1b" not in report

    def test_file_with_another_case(self, folder):
        (folder / "tool.yaml").rename(folder / "tool.YAML")
        assert open_cargo(str(folder / "tool.YAML")).payload == Payload.load(folder / "tool.YAML")


@pytest.mark.parametrize("name", ["compare", "forces"])
@pytest.mark.parametrize("options", [[], ["--payload", "tool.yaml"]])
def test_geometry_alone_is_told_first_and_leaves_nothing(name, options, folder, capfd):
    before = sorted(folder.rglob("*"))
    assert command(name, "dietmaier1998", "line", *options, "--output", "out.csv") == 2
    assert ": platform.mass: missing" in capfd.readouterr().err
    assert sorted(folder.rglob("*")) == before


def test_without_a_payload_nothing_is_said_of_one(wu2012):
    comparison = compare(wu2012, bundled("line", wu2012, 5), ["kane"])
    assert comparison.results["payload"] is None


@PINOCCHIO
class TestRobot:
    def test_wrapped_recording_of_an_endless_joint_is_the_one_that_is_not(self, folder, capfd):
        (folder / "wheel.urdf").write_text(URDF.replace("prismatic", "continuous"))
        time = np.linspace(0, 2, 201)
        angle = 3 * time + 2
        for name, column in (("plain", angle), ("wrapped", (angle + np.pi) % (2 * np.pi) - np.pi)):
            put(folder, {"t": time, "q1": column}).rename(folder / f"{name}.csv")
            options = (
                "--payload",
                "wheel.urdf",
                "--payload-motion",
                f"{name}.csv",
                "--output",
                f"f{name}.csv",
            )
            assert command("forces", "wu2012", "sinusoids", "--samples", 50, *options) == 0
        said = "sixsps: payload: recorded angles jump by whole turns, which were added: q1\n"
        assert capfd.readouterr().err == said
        plain = forces_in("fplain.csv")
        np.testing.assert_allclose(forces_in("fwrapped.csv"), plain, rtol=0, atol=1e-9 * np.abs(plain).max())

    def test_limits_that_are_left_are_told_and_change_nothing(self, folder, capfd):
        (folder / "arm.urdf").write_text(URDF)
        (folder / "wide.urdf").write_text(URDF.replace('upper="1"', 'upper="9"'))
        time = np.linspace(0, 2, 25)
        put(folder, {"t": time, "lift": time, "dlift": 0 * time + 1, "ddlift": 0 * time})
        for name in ("arm", "wide"):
            options = ("--payload", f"{name}.urdf", "--payload-motion", "path.csv", "--samples", 25)
            assert command("forces", "wu2012", "line", *options, "--output", f"{name}.csv") == 0
        said = "sixsps: payload: joints leave their limits: lift to 2 m at t = 2 s (0 to 1)\n"
        assert capfd.readouterr().err == said
        assert (folder / "arm.csv").read_bytes() == (folder / "wide.csv").read_bytes()
        options = ("--payload", "arm.urdf", "--payload-motion", "path.csv", "--samples", 25)
        assert command("compare", "wu2012", "line", *options, "--engine", "kane") == 0
        shown = "payload: joints leave their limits: lift to 2 m at t = 2 s (0 to 1)"
        assert shown in " ".join(capfd.readouterr().out.split())
        assert "joints leave their limits" in (folder / "report" / "report.md").read_text()

    def test_comparison_with_the_whole_tree(self, folder, capfd):
        time = np.linspace(-1, 3, 200)
        file = joint_motion(folder, time, [f"q{joint}" for joint in range(1, 10)])
        arguments = ("--samples", 30, "--payload", "panda", "--payload-motion", file)
        engines = ("--engine", "kane", "--engine", "mujoco", "--engine", "pinocchio-payload")
        place = ("--payload-mount", "0,0,0.1,0,0,0.5")
        assert command("compare", "taghirad2013", "sinusoids", *arguments, *engines, *place) == 0
        said = " ".join(capfd.readouterr().out.split())
        assert "payload: panda, 17.45 kg, 9 joints: path; its wrench on the platform, up to" in said
        results = json.loads((folder / "report" / "results.json").read_text())
        row = results["engines"]["pinocchio-payload"]
        assert row["status"] == "ok"
        assert row["max_rel_error"] < 1e-13
        assert results["payload"]["motion"]["estimated"] == ""
        report = (folder / "report" / "report.md").read_text()
        assert "is given no such wrench" in report
        assert "base at 0, 0, 0.1 m in the platform frame, turned" in report

    def test_report_says_where_nothing_checks_the_wrench(self, folder):
        assert (
            command("compare", "wu2012", "line", "--samples", 5, "--payload", "ur5", "--engine", "kane") == 0
        )
        assert "Nothing here checks the wrench itself" in (folder / "report" / "report.md").read_text()

    def test_whole_tree_is_compared_by_default(self, wu2012):
        from compare.registry import with_legs
        from sixsps.legs import Legs

        assert "pinocchio-payload" in with_legs(Legs.sps, robot=True)
        assert "pinocchio-payload" not in with_legs(Legs.sps)
        assert "pinocchio-payload" not in with_legs(Legs.ups, robot=True)

    def test_wrong_wrench_is_told_by_the_whole_tree(self, wu2012):
        """Engines all agree under a wrong wrench, and so does what certifies them: only the tree knows."""
        motion = bundled("sinusoids", wu2012, 10)
        aboard = open_cargo("ur5").aboard(wu2012, motion)
        wrong = replace(aboard, motion=replace(aboard.motion, force=aboard.motion.force * (1 + 1e-9)))
        comparison = compare(wu2012, motion, ["kane", "mujoco", "pinocchio-payload"], aboard=wrong)
        assert not comparison.agreed
        verdicts = {name: row["within_tolerance"] for name, row in comparison.results["engines"].items()}
        assert verdicts == {"kane": True, "mujoco": True, "pinocchio-payload": False}

    def test_forces_are_those_of_the_comparison(self, folder, wu2012):
        time = np.linspace(0, 2, 25)
        joint_motion(folder, time, find_names("ur5"))
        options = ("--samples", 25, "--payload", "ur5", "--payload-motion", "path.csv")
        assert command("forces", "wu2012", "line", *options, "--output", "f.csv") == 0
        cargo = open_cargo("ur5", folder / "path.csv")
        aboard = cargo.aboard(wu2012, bundled("line", wu2012, 25))
        np.testing.assert_array_equal(forces_in("f.csv"), sixsps.inverse_dynamics(wu2012, aboard.motion))
        assert np.abs(aboard.ride.joints.acceleration).max() > 0.9

    def test_rows_at_which_the_hexapod_is_singular_are_left_out(self, wu2012):
        motion = bundled("line", wu2012, 4)
        position = motion.position.copy()
        position[2] = [0, 0, 0]  # flat
        motion = replace(motion, position=position)
        aboard = open_cargo("panda").aboard(wu2012, motion)
        comparison = compare(wu2012, motion, ["kane", "pinocchio-payload"], aboard=aboard)
        forces = comparison.outcomes[1].forces
        assert np.isnan(forces).all(axis=1).tolist() == [False, False, True, False]
        assert comparison.results["engines"]["pinocchio-payload"]["within_tolerance"]

    def test_every_robot_that_there_is_can_be_named(self, capfd):
        from compare.payload.robot import RobotModel

        for name in robots():
            robot = RobotModel(find_robot(name))
            assert robot.mass > 0, name
            assert len(robot.standing[1]) == len(robot.names)
        assert RobotModel(find_robot("talos")).standing[0] == "half_sitting"
        assert RobotModel(find_robot("kinova")).standing[0] == "neutral"
        assert capfd.readouterr() == ("", "")

    def test_file_of_a_robot_is_the_robot_of_that_name(self, wu2012):
        by_name, by_path = open_cargo("ur5"), open_cargo(str(robots()["ur5"]))
        motion = bundled("line", wu2012, 3)
        forces = [cargo.aboard(wu2012, motion).motion.force for cargo in (by_name, by_path)]
        np.testing.assert_array_equal(*forces)


def find_names(robot):
    from compare.payload.robot import RobotModel

    return RobotModel(find_robot(robot)).names


URDF = """<robot name="arm"><link name="base"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="tip"><inertial>
<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="lift" type="prismatic"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/>
<limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>"""
REFUSED = {
    "unknown robot": (
        ["--payload", "pandda"],
        "payload: pandda; allowed: a file (.yaml of a rigid body, .urdf",
    ),
    "motion alone": (["--payload-motion", "m.csv"], "--payload-motion: m.csv; allowed: only with a robot"),
    "mount alone": (["--payload-mount", "0,0,0"], "--payload-mount: 0,0,0; allowed: only with a robot"),
    "motion of a tool": (
        ["--payload", "tool.yaml", "--payload-motion", "m.csv"],
        "--payload-motion: m.csv; allowed: only with a robot as --payload",
    ),
    "short mount": (
        ["--payload", "ur5", "--payload-mount", "0,0"],
        "--payload-mount: 0,0; allowed: x,y,z or x,y,z,roll,pitch,yaw",
    ),
    "no number": (["--payload", "ur5", "--payload-mount", "0,0,nan"], "--payload-mount: 0,0,nan; allowed"),
    "no file": (["--payload", "no.yaml"], "no.yaml: payload: no such file; allowed: an existing file"),
    "no robot": (["--payload", "no.urdf"], "no.urdf: payload: no such file; allowed: an existing file"),
    "no motion": (
        ["--payload", "ur5", "--payload-motion", "no.csv"],
        "no.csv: motion: no such file; allowed: an existing file",
    ),
    "short motion": (
        ["--payload", "arm.urdf", "--payload-motion", "short.csv"],
        "short.csv: t: 0 to 1 s; allowed: the times of the platform's motion, 0 to 2 s",
    ),
    "no urdf": (["--payload", "text.urdf"], "text.urdf: payload: "),
    "empty urdf": (["--payload", "empty.urdf"], "empty.urdf: payload: an empty file; allowed: "),
    "folder": (["--payload", "folder.urdf"], "folder.urdf: payload: a directory; allowed: a file"),
    "nan": (
        ["--payload", "nan.urdf"],
        "nan.urdf: payload: Error: Inertial: mass [nan] is not a float; allowed",
    ),
    "minus": (["--payload", "minus.urdf"], "minus.urdf: link base, mass: -1.0; allowed: at least 0 [kg]"),
    "heavy": (
        ["--payload", "heavy.urdf"],
        "heavy.urdf: payload: a wrench beyond 1e+50 N or N m; allowed: a robot and motions that exert less",
    ),
    "far": (["--payload", "far.yaml"], "far.yaml: "),
    "floating": (
        ["--payload", "float.urdf"],
        "float.urdf: joint lift: 6 degrees of freedom; allowed: joints of one degree of freedom",
    ),
}


@PINOCCHIO
@pytest.mark.parametrize("case", REFUSED)
@pytest.mark.parametrize("name", ["compare", "forces"])
def test_what_is_refused_in_one_line_with_nothing_written(case, name, folder, capfd):
    contents = {"text": "hello", "empty": "", "arm": URDF, "float": URDF.replace("prismatic", "floating")}
    contents["minus"] = URDF.replace('mass value="1"', 'mass value="-1"', 1)
    contents["nan"] = URDF.replace('mass value="1"', 'mass value="nan"', 1)
    for stem, content in contents.items():
        (folder / f"{stem}.urdf").write_text(content)
    (folder / "heavy.urdf").write_text(URDF.replace('mass value="1"', 'mass value="1e50"', 1))
    (folder / "far.yaml").write_text(TOOL.replace("0.15", "1e49"))
    (folder / "folder.urdf").mkdir()
    (folder / "short.csv").write_text("t,lift\n" + "".join(f"{k / 10},0\n" for k in range(11)))
    before = sorted(folder.rglob("*"))
    options, said = REFUSED[case]
    output = ["--output", "out" if name == "compare" else "out.csv"]
    assert command(name, "wu2012", "line", "--samples", 5, *options, *output) == 2
    captured = capfd.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"sixsps: {said}"), captured.err
    assert captured.err.count("\n") == 1, captured.err
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize("options", [[], ["--payload", "tool.yaml"]])
def test_engine_of_the_whole_tree_needs_a_robot(options, folder, capfd):
    engine = ("--engine", "pinocchio-payload")
    assert command("compare", "wu2012", "line", "--samples", 5, *engine, *options) == 2
    assert "only in a comparison with a robot as --payload" in capfd.readouterr().err


def test_output_over_an_input_is_refused(folder, capfd):
    joint_motion(folder, np.linspace(0, 2, 5), ["q1"])
    options = ("--payload", "ur5", "--payload-motion", "path.csv", "--output", "path.csv")
    assert command("forces", "wu2012", "line", "--samples", 5, *options) == 2
    assert "path.csv: output: an input of this command; allowed: another file" in capfd.readouterr().err


def test_robot_without_pinocchio(folder, monkeypatch, capfd):
    here = importlib.util.find_spec
    monkeypatch.setattr("urdf.libraries.find_spec", lambda name: None if name == "pinocchio" else here(name))
    monkeypatch.setitem(sys.modules, "compare.payload.robot", None)
    (folder / "arm.urdf").write_text(URDF)
    assert command("forces", "wu2012", "line", "--payload", "arm.urdf", "--output", "f.csv") == 1
    assert (
        capfd.readouterr().err == "sixsps: engine pinocchio is not available: package pin is not installed\n"
    )
    assert command("forces", "wu2012", "line", "--payload", "tool.yaml", "--output", "f.csv") == 0


def test_robots_by_name_without_their_package(monkeypatch):
    def missing(name):
        raise catalogue.PackageNotFoundError(name)

    monkeypatch.setattr(catalogue, "distribution", missing)
    assert robots() == {}
    with pytest.raises(
        UnknownNameError, match=r"example-robot-data, which has robots by name, is not installed"
    ):
        find_robot("panda")


def test_geometry_alone_carries_no_robot():
    pytest.importorskip("pinocchio")
    with pytest.raises(MechanismError, match="missing"):
        open_cargo("ur5").aboard(
            sixsps.Mechanism.load("dietmaier1998"), bundled("line", sixsps.Mechanism.load("wu2012"), 3)
        )
