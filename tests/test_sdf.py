"""The SDF: a graph with its loops closed, exact, and what readers of SDF make of it."""

import dataclasses
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from cases import BUNDLED, at_rest, random_mechanism
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import sixsps
from compare.cli import app
from sixsps.errors import InputError, MechanismError
from sixsps.home import home_position
from sixsps.legs import Legs
from sixsps.limits import Limits
from sixsps.mechanism import Mechanism
from urdf import render_mjcf, render_sdf, render_urdf
from urdf.options import Loops

LEGS = range(1, 7)
EPS = np.finfo(float).eps


@pytest.fixture(params=[*BUNDLED, "random 0", "random 1", "random 2"])
def any_mechanism(request):
    kind, _, seed = request.param.partition(" ")
    return random_mechanism(int(seed)) if seed else Mechanism.load(kind)


@pytest.fixture(params=Legs)
def graph(request, any_mechanism):
    text = render_sdf(any_mechanism, request.param)
    return any_mechanism, request.param, ET.fromstring(text).find("world/model")


def numbers(element, path):
    found = element.find(path)
    return np.zeros(6) if found is None else np.array([float(word) for word in found.text.split()])


def placement(element):
    """Pose as rotation and position."""
    values = numbers(element, "pose")
    return Rotation.from_euler("xyz", values[3:]).as_matrix(), values[:3]


def joint_of(model, name):
    return next(joint for joint in model.findall("joint") if joint.get("name") == name)


class TestGraph:
    def test_joints_close_six_loops(self, graph):
        _, legs, model = graph
        links = {link.get("name") for link in model.findall("link")}
        joints = [
            (j.get("type"), j.find("parent").text, j.find("child").text) for j in model.findall("joint")
        ]
        at_base = "ball" if legs is Legs.sps else "universal"
        assert len(links) == 14
        expected = [("fixed", "world", "base")]
        for i in LEGS:
            expected += [
                (at_base, "base", f"leg{i}_lower"),
                ("prismatic", f"leg{i}_lower", f"leg{i}_upper"),
                ("ball", f"leg{i}_upper", "platform"),
            ]
        assert sorted(joints) == sorted(expected)
        assert len({joint.get("name") for joint in model.findall("joint")}) == 19

    def test_ends_of_every_loop_coincide_at_home(self, graph):
        """A joint's pose is told from its child, a link's from the model: what SDF means by default."""
        mechanism, _, model = graph
        links = {link.get("name"): placement(link) for link in model.findall("link")}
        home = home_position(mechanism)
        size = np.abs(mechanism.base_anchors).max() + np.abs(home).max()
        turn, origin = links["platform"]
        assert np.array_equal(turn, np.eye(3))
        assert np.array_equal(origin, home)
        for i in LEGS:
            _, anchor = placement(joint_of(model, f"leg{i}_closure"))
            assert np.array_equal(anchor, mechanism.platform_anchors[i - 1])
            assert np.array_equal(links[f"leg{i}_lower"][1], mechanism.base_anchors[i - 1])
            axes, tip = links[f"leg{i}_upper"]
            assert np.abs(tip - origin - anchor).max() <= 4 * EPS * size
            leg = tip - mechanism.base_anchors[i - 1]
            np.testing.assert_allclose(axes[:, 2], leg / np.linalg.norm(leg), atol=16 * EPS * size)

    def test_carries_the_numbers_exactly(self, graph):
        mechanism, _, model = graph
        links = {link.get("name"): link.find("inertial") for link in model.findall("link")}
        expected = {"platform": (mechanism.platform.mass, mechanism.platform.com, mechanism.platform.inertia)}
        for i, leg in zip(LEGS, mechanism.legs, strict=True):
            for name, link, sense in (("lower", leg.lower, 1), ("upper", leg.upper, -1)):
                moments = np.diag([link.transverse, link.transverse, link.axial])
                expected[f"leg{i}_{name}"] = link.mass, [0, 0, sense * link.com], moments
        for name, (mass, com, inertia) in expected.items():
            assert float(links[name].find("mass").text) == mass
            assert np.array_equal(numbers(links[name], "pose"), [*com, 0, 0, 0])
            for tag, (i, j) in {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}.items():
                assert float(links[name].find(f"inertia/{tag}").text) == inertia[i, j]

    def test_strokes_and_axes(self, graph):
        mechanism, legs, model = graph
        home = np.linalg.norm(
            home_position(mechanism) + mechanism.platform_anchors - mechanism.base_anchors, axis=1
        )
        for i in LEGS:
            axis = joint_of(model, f"leg{i}_actuator").find("axis")
            assert axis.find("xyz").text == "0.0 0.0 1.0"
            stroke = [float(axis.find(f"limit/{end}").text) for end in ("lower", "upper")]
            np.testing.assert_allclose(stroke + home[i - 1], mechanism.length_limits[i - 1], rtol=4 * EPS)
            if legs is Legs.ups:
                universal = joint_of(model, f"leg{i}_universal")
                assert [universal.find(f"{tag}/xyz").text for tag in ("axis", "axis2")] == [
                    "1.0 0.0 0.0",
                    "0.0 1.0 0.0",
                ]

    def test_gravity_is_the_world_s(self, any_mechanism):
        world = ET.fromstring(render_sdf(any_mechanism)).find("world")
        assert np.array_equal(numbers(world, "gravity"), any_mechanism.gravity)


class TestText:
    def test_actuators_have_the_strength_of_the_machine(self, wu2012):
        limits = Limits(force=[-200, 150], rate=0.4)
        strong = dataclasses.replace(wu2012, limits=limits)
        model = ET.fromstring(render_sdf(strong)).find("world/model")
        for i in LEGS:
            limit = joint_of(model, f"leg{i}_actuator").find("axis/limit")
            assert (limit.find("effort").text, limit.find("velocity").text) == ("200.0", "0.4")
        assert "effort" not in render_sdf(wu2012)

    @pytest.mark.parametrize(
        ("name", "model"),
        [
            ("wu2012", "wu2012"),
            ("world", "hexapod"),
            ("__model__", "model"),
            ("a::b", "a_b"),
            ('--><script>alert("\'")</script>&', "--_script_alert_script"),
            ("六足", "hexapod"),
        ],
    )
    def test_hostile_names_are_harmless(self, wu2012, name, model):
        root = ET.fromstring(render_sdf(dataclasses.replace(wu2012, name=name)))
        assert root.find("world/model").get("name") == model
        assert root.find(".//script") is None

    def test_options_by_their_text(self, wu2012):
        assert render_sdf(wu2012, "ups", "drake") == render_sdf(wu2012, Legs.ups, Loops.drake)
        assert render_sdf(wu2012, "sps", "joints") == render_sdf(wu2012)
        for render in (render_urdf, render_mjcf, render_sdf):
            assert render(wu2012, "sps") == render(wu2012, Legs.sps)

    def test_unknown_options_are_refused(self, wu2012):
        with pytest.raises(InputError, match=r"^loops: welds; allowed: joints or drake$"):
            render_sdf(wu2012, loops="welds")
        for render in (render_urdf, render_mjcf, render_sdf):
            for legs in ("rrr", None, "UPS"):
                with pytest.raises(InputError, match=rf"^legs: {legs}; allowed: sps or ups$"):
                    render(wu2012, legs)

    def test_geometry_alone_has_no_bodies(self):
        with pytest.raises(MechanismError, match=r"^gravity: missing"):
            render_sdf(Mechanism.load("dietmaier1998"))


class TestCommand:
    def test_writes_one_file(self, tmp_path):
        target = tmp_path / "mine.sdf"
        done = CliRunner().invoke(app, ["export", "sdf", "wu2012", "--output", str(target)])
        assert (done.exit_code, done.output) == (0, f"{target}\n")
        assert target.read_text() == render_sdf(Mechanism.load("wu2012"))

    def test_options(self, tmp_path):
        arguments = ["--legs", "ups", "--loops", "drake", "--output", str(tmp_path)]
        done = CliRunner().invoke(app, ["export", "sdf", "tsai2000", *arguments])
        assert done.exit_code == 0
        written = (tmp_path / "tsai2000.sdf").read_text()
        assert written == render_sdf(Mechanism.load("tsai2000"), Legs.ups, Loops.drake)

    @pytest.mark.parametrize("kind", ["sdf", "urdf", "mjcf"])
    def test_geometry_alone_is_told_in_one_line_and_leaves_nothing(self, kind, tmp_path):
        arguments = ["export", kind, "dietmaier1998", "--output", str(tmp_path / "new")]
        done = CliRunner().invoke(app, arguments)
        assert isinstance(done.exception, MechanismError)
        assert str(done.exception).startswith("gravity: missing")
        assert not (tmp_path / "new").exists()


@pytest.fixture
def drake():
    pytest.importorskip("pydrake")
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant

    def load(text, step=0.0):
        plant = MultibodyPlant(step)
        if step:
            plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
        Parser(plant).AddModelsFromString(text, "sdf")
        return plant

    return load


class TestDrake:
    def test_reads_all_joints_and_refuses_the_loops(self, drake, wu2012):
        """A fact about Drake, and why `Loops.drake` is there: once it changes, that can go."""
        plant = drake(render_sdf(wu2012))
        kinds = [plant.get_joint(joint).type_name() for joint in plant.GetJointIndices()]
        assert sorted(kinds) == ["ball_rpy"] * 12 + ["prismatic"] * 6 + ["weld"]
        with pytest.raises(RuntimeError, match="form one or more loops in the system graph"):
            plant.Finalize()

    def test_closures_as_read(self, drake, any_mechanism):
        plant = drake(render_sdf(any_mechanism))
        size = np.abs(any_mechanism.base_anchors).max() + np.abs(home_position(any_mechanism)).max()
        for i in LEGS:
            closure = plant.GetJointByName(f"leg{i}_closure")
            tip = closure.frame_on_parent().GetFixedPoseInBodyFrame().translation()
            anchor = closure.frame_on_child().GetFixedPoseInBodyFrame().translation()
            assert (closure.parent_body().name(), closure.child_body().name()) == (
                f"leg{i}_upper",
                "platform",
            )
            assert np.abs(tip).max() <= 16 * EPS * size
            assert np.abs(anchor - any_mechanism.platform_anchors[i - 1]).max() <= 16 * EPS * size

    @pytest.mark.parametrize("loops", Loops)
    @pytest.mark.parametrize("legs", Legs)
    def test_warns_of_nothing_but_gravity(self, drake, wu2012, legs, loops, caplog):
        with caplog.at_level("WARNING"):
            drake(render_sdf(wu2012, legs, loops))
        assert len(caplog.messages) == 1
        assert "Ignoring unsupported SDFormat element in world: gravity" in caplog.messages[0]

    @pytest.mark.parametrize("loops", Loops)
    def test_takes_any_name(self, drake, wu2012, loops):
        """Some of these names end the process when Drake meets them in a URDF."""
        for name in ("world", "__model__", "a::b", "<script>", "\"'&", "六足", "--><x/>", ".."):
            drake(render_sdf(dataclasses.replace(wu2012, name=name), loops=loops))

    def test_its_own_constraints_hold_the_loops(self, drake, wu2012):
        """50 ms of falling, actuators slack. The gaps are what SAP's regularisation leaves, 2e-7 m."""
        from pydrake.systems.analysis import Simulator

        plant = drake(render_sdf(wu2012, loops=Loops.drake), step=1e-3)
        plant.Finalize()
        assert (plant.num_constraints(), plant.num_velocities(), plant.num_actuators()) == (6, 30, 6)
        simulator = Simulator(plant)
        plant.get_actuation_input_port().FixValue(simulator.get_mutable_context(), np.zeros(6))
        simulator.AdvanceTo(0.05)
        at = simulator.get_context()
        platform = plant.GetBodyByName("platform").EvalPoseInWorld(at)
        assert home_position(wu2012)[2] - platform.translation()[2] > 0.01
        for i, anchor in zip(LEGS, wu2012.platform_anchors, strict=True):
            tip = plant.GetBodyByName(f"leg{i}_upper").EvalPoseInWorld(at).translation()
            assert np.abs(tip - platform @ anchor).max() <= 1e-6

    @pytest.mark.parametrize("legs", Legs)
    def test_weights_are_held_by_the_same_forces(self, drake, any_mechanism, legs):
        """At home, with gravity set by hand: every mass and centre of mass at once."""
        from readers import DrakeReader

        plant = drake(render_sdf(any_mechanism, legs, Loops.drake))
        plant.mutable_gravity_field().set_gravity_vector(any_mechanism.gravity)
        plant.Finalize()
        reader = DrakeReader(plant, any_mechanism.platform_anchors)
        closures = reader.read().system()[6:]
        matrix = np.hstack([np.eye(plant.num_velocities())[:, reader.actuated], closures.T])
        weights = -plant.CalcGravityGeneralizedForces(reader.context)
        found = np.linalg.lstsq(matrix, weights, rcond=1e-12)[0][:6]
        expected = sixsps.inverse_dynamics(any_mechanism, at_rest(home_position(any_mechanism)))[0]
        np.testing.assert_allclose(found, expected, atol=1e-11 * np.abs(expected).max())


class TestDart:
    @pytest.fixture
    def read(self, tmp_path):
        dartpy = pytest.importorskip("dartpy")

        def load(text):
            path = tmp_path / "hexapod.sdf"
            path.write_text(text)
            return dartpy.utils.SdfParser.readWorld(f"file://{path}")

        return load

    def test_keeps_the_first_closure_and_says_that_it_drops_the_others(self, read, wu2012, capfd):
        skeleton = read(render_sdf(wu2012)).getSkeleton(0)
        said = capfd.readouterr()
        kinds = [joint.getType() for joint in skeleton.getJoints()]
        assert sorted(kinds) == ["BallJoint"] * 7 + ["PrismaticJoint"] * 6 + ["WeldJoint"]
        for i in range(2, 7):
            assert f"Joint [leg{i}_closure] will be discarded" in said.err

    def test_reads_no_newer_version(self, read, wu2012, capfd):
        """Why the file is of version 1.6, which has all that it needs."""
        text = render_sdf(wu2012)
        assert read(text.replace('version="1.6"', 'version="1.7"')) is None
        assert "was found to be [1.7], but we only support SDF 1.4, 1.5, and 1.6!" in capfd.readouterr().err

    def test_reads_masses_and_inertias_exactly(self, read, any_mechanism):
        skeleton = read(render_sdf(any_mechanism)).getSkeleton(0)
        platform = any_mechanism.platform
        expected = {"platform": (platform.mass, platform.com, platform.inertia)}
        for i, leg in zip(LEGS, any_mechanism.legs, strict=True):
            for name, link, sense in (("lower", leg.lower, 1), ("upper", leg.upper, -1)):
                moments = np.diag([link.transverse, link.transverse, link.axial])
                expected[f"leg{i}_{name}"] = link.mass, [0, 0, sense * link.com], moments
        for name, (mass, com, inertia) in expected.items():
            body = skeleton.getBodyNode(name)
            assert body.getMass() == mass
            assert np.array_equal(body.getLocalCOM(), com)
            assert np.array_equal(body.getInertia().getMoment(), inertia)
