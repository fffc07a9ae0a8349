"""The generated descriptions: valid for others, exact, and assembled at home."""

import dataclasses
import os
import subprocess
import sysconfig
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import yaml
from cases import BUNDLED, random_mechanism
from scipy.spatial.transform import Rotation

import urdf
from sixsps.bodies import Platform
from sixsps.home import home_position
from sixsps.mechanism import Mechanism
from urdf.export import export_mjcf, export_urdf, file_stem

LEGS = range(1, 7)


@pytest.fixture(params=[*BUNDLED, "random 0", "random 1", "random 2"])
def any_mechanism(request):
    kind, _, seed = request.param.partition(" ")
    return random_mechanism(int(seed)) if seed else Mechanism.load(kind)


@pytest.fixture
def tree(any_mechanism):
    return any_mechanism, ET.fromstring(urdf.render_urdf(any_mechanism))


def numbers(element, attribute):
    return np.array([float(word) for word in element.get(attribute).split()])


class TestUrdf:
    def test_is_one_tree_rooted_at_base(self, tree):
        _, robot = tree
        links = [link.get("name") for link in robot.iter("link")]
        children = [joint.find("child").get("link") for joint in robot.iter("joint")]
        parents = [joint.find("parent").get("link") for joint in robot.iter("joint")]
        assert len(set(links)) == len(links)
        assert len(set(children)) == len(children)
        assert set(links) - set(children) == {"base"}
        assert set(parents) <= set(links)

    def test_has_joints_that_readers_know_and_30_velocities(self, tree):
        _, robot = tree
        kinds = [joint.get("type") for joint in robot.findall("joint")]
        assert {kind: kinds.count(kind) for kind in set(kinds)} == {
            "floating": 1,
            "revolute": 18,
            "prismatic": 6,
            "fixed": 12,
        }
        for joint in robot.findall("joint"):
            if joint.get("type") in ("revolute", "prismatic"):
                limit = joint.find("limit")
                assert float(limit.get("lower")) < float(limit.get("upper"))
                assert float(limit.get("effort")) > 0
                assert float(limit.get("velocity")) > 0

    def test_carries_the_numbers_exactly(self, tree):
        mechanism, robot = tree
        links = {link.get("name"): link.find("inertial") for link in robot.findall("link")}
        platform = links["platform"]
        assert float(platform.find("mass").get("value")) == mechanism.platform.mass
        assert np.array_equal(numbers(platform.find("origin"), "xyz"), mechanism.platform.com)
        entries = platform.find("inertia")
        for name, (i, j) in {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}.items():
            assert float(entries.get(name)) == mechanism.platform.inertia[i, j]
        for i, leg in zip(LEGS, mechanism.legs, strict=True):
            for half, link, sense in (("lower", leg.lower, 1), ("upper", leg.upper, -1)):
                inertial = links[f"leg{i}_{half}"]
                assert float(inertial.find("mass").get("value")) == link.mass
                assert numbers(inertial.find("origin"), "xyz")[2] == sense * link.com
                assert float(inertial.find("inertia").get("ixx")) == link.transverse
                assert float(inertial.find("inertia").get("izz")) == link.axial
        joints = {joint.get("name"): joint for joint in robot.findall("joint")}
        for i in LEGS:
            base = numbers(joints[f"leg{i}_ball_x"].find("origin"), "xyz")
            anchor = numbers(joints[f"platform_anchor{i}_fixed"].find("origin"), "xyz")
            assert np.array_equal(base, mechanism.base_anchors[i - 1])
            assert np.array_equal(anchor, mechanism.platform_anchors[i - 1])

    def test_every_body_is_drawn(self, tree):
        _, robot = tree
        drawn = {link.get("name") for link in robot.findall("link") if link.find("visual") is not None}
        assert drawn == {"base", "platform"} | {f"leg{i}_{half}" for i in LEGS for half in ("lower", "upper")}
        assert len(list(robot.iter("cylinder"))) == 14

    def test_names_no_path_of_this_machine(self, tree):
        mechanism, _ = tree
        text = urdf.render_urdf(mechanism)
        assert "xacro" not in text
        assert str(Path.home()) not in text
        assert "${" not in text

    def test_tells_given_from_assumed(self, wu2012):
        for text in (urdf.render_urdf(wu2012), urdf.render_mjcf(wu2012)):
            assert "Given by: Wu, Xiong & Kong" in text
            for key in wu2012.assumed:
                assert f"Assumed, not given: {key}: " in text

    def test_no_source_ends_the_comment_it_stands_in(self, wu2012):
        hostile = dataclasses.replace(wu2012, source="--><evil/><!--", assumed={"a--": "\n--->"})
        for text in (urdf.render_urdf(hostile), urdf.render_mjcf(hostile)):
            assert ET.fromstring(text).find("evil") is None

    def test_passes_check_urdf(self, any_mechanism, tmp_path):
        """The ROS community's own checker, as Pinocchio's wheel ships it."""
        prefix = Path(sysconfig.get_path("purelib")) / "cmeel.prefix"
        program = prefix / "bin" / "check_urdf"
        if not program.exists():
            pytest.skip("check_urdf comes with pin, which is not installed")
        path = export_urdf(any_mechanism, tmp_path)[0]
        environment = os.environ | {"LD_LIBRARY_PATH": str(prefix / "lib")}
        done = subprocess.run([program, path], capture_output=True, text=True, env=environment)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "Successfully Parsed XML" in done.stdout
        assert "root Link: base has 7 child(ren)" in done.stdout


class TestClosures:
    def test_frames_exist_and_coincide_at_home(self, any_mechanism):
        pin = pytest.importorskip("pinocchio")
        model = pin.buildModelFromXML(urdf.render_urdf(any_mechanism))
        data = model.createData()
        closures = yaml.safe_load(urdf.render_closures())
        assert closures["type"] == ["3d"] * 6
        assert [name for name in closures["name_mot"] if not model.existJointName(name)] == []
        pin.framesForwardKinematics(model, data, pin.neutral(model))
        size = np.abs(any_mechanism.base_anchors).max() + np.abs(home_position(any_mechanism)).max()
        assert len(closures["closed_loop"]) == 6
        for tip, anchor in closures["closed_loop"]:
            assert model.existFrame(tip)
            assert model.existFrame(anchor)
            gap = data.oMf[model.getFrameId(tip)].translation - data.oMf[model.getFrameId(anchor)].translation
            assert np.abs(gap).max() <= 8 * np.finfo(float).eps * size

    def test_read_back(self):
        assert urdf.parse_closures(urdf.render_closures()) == urdf.closures.CLOSURES


class TestMjcf:
    def test_loads_in_mujoco_with_the_same_masses(self, any_mechanism):
        mujoco = pytest.importorskip("mujoco")
        model = mujoco.MjModel.from_xml_string(urdf.render_mjcf(any_mechanism))
        assert (model.nq, model.nv, model.neq, model.nu) == (37, 30, 6, 6)
        assert np.array_equal(model.opt.gravity, any_mechanism.gravity)
        platform = model.body("platform")
        assert platform.mass[0] == any_mechanism.platform.mass
        principal = np.sort(np.linalg.eigvalsh(any_mechanism.platform.inertia))
        np.testing.assert_allclose(np.sort(platform.inertia), principal, rtol=1e-12)
        for i, leg in zip(LEGS, any_mechanism.legs, strict=True):
            assert model.body(f"leg{i}_lower").mass[0] == leg.lower.mass
            assert model.body(f"leg{i}_upper").mass[0] == leg.upper.mass

    @pytest.mark.parametrize("seed", range(30))
    def test_turned_thin_plates_load_in_mujoco(self, wu2012, seed):
        """Equality in the triangle inequality, which rounding breaks one way or the other."""
        mujoco = pytest.importorskip("mujoco")
        turn = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
        inertia = turn @ np.diag([0.0025, 0.0025, 0.005]) @ turn.T
        platform = Platform(1.0, [0.01, 0.02, 0.03], (inertia + inertia.T) / 2)
        turned = dataclasses.replace(wu2012, platform=platform)
        model = mujoco.MjModel.from_xml_string(urdf.render_mjcf(turned))
        body = model.body("platform")
        axes = Rotation.from_quat(body.iquat, scalar_first=True).as_matrix()
        np.testing.assert_allclose(axes @ np.diag(body.inertia) @ axes.T, inertia, atol=1e-16)

    def test_is_assembled_at_home_in_mujoco(self, any_mechanism):
        mujoco = pytest.importorskip("mujoco")
        model = mujoco.MjModel.from_xml_string(urdf.render_mjcf(any_mechanism))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        size = np.abs(any_mechanism.base_anchors).max() + np.abs(home_position(any_mechanism)).max()
        for i in LEGS:
            gap = data.site(f"leg{i}_tip").xpos - data.site(f"platform_anchor{i}").xpos
            assert np.abs(gap).max() <= 1e-14 * size
            lower = data.body(f"leg{i}_lower").xpos
            np.testing.assert_allclose(lower, any_mechanism.base_anchors[i - 1], atol=1e-15 * size)

    def test_loads_in_pinocchio_with_all_closures(self, any_mechanism, tmp_path):
        pin = pytest.importorskip("pinocchio")
        path = export_mjcf(any_mechanism, tmp_path)[0]
        model, closures, _ = pin.buildModelAndConstraintsFromMJCF(str(path))
        assert (model.nq, model.nv) == (37, 30)
        assert len(closures) == 6
        masses = any_mechanism.platform.mass + any_mechanism.lower.mass.sum() + any_mechanism.upper.mass.sum()
        moving = sum(inertia.mass for inertia in list(model.inertias)[1:])
        assert moving == pytest.approx(masses, rel=1e-14)


class TestExport:
    def test_urdf_writes_three_files_into_a_new_folder(self, wu2012, tmp_path):
        written = export_urdf(wu2012, tmp_path / "description")
        assert [path.name for path in written] == ["wu2012.urdf", "wu2012.yaml", "wu2012.xml"]
        assert sorted(path.name for path in (tmp_path / "description").iterdir()) == sorted(
            path.name for path in written
        )
        assert written[0].read_text() == urdf.render_urdf(wu2012)

    def test_a_file_name_is_taken_as_one(self, wu2012, tmp_path):
        assert export_urdf(wu2012, tmp_path / "mine.urdf")[1] == tmp_path / "mine.yaml"
        assert export_mjcf(wu2012, tmp_path / "mine.xml") == [tmp_path / "mine.xml"]

    @pytest.mark.parametrize(
        ("name", "stem"),
        [
            ("wu2012", "wu2012"),
            ("../../etc/passwd", "etc_passwd"),
            ("..", "hexapod"),
            ("${1+1} $(find x)", "1_1_find_x"),
            ("<script>", "script"),
            ("héxapod/Δ", "h_xapod"),
            ("CON " * 60, ("CON_" * 60)[:60]),
        ],
    )
    def test_file_stem_is_harmless(self, name, stem):
        assert file_stem(name) == stem
