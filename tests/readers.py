"""Engines that read an exported description, behind one face, and the pose that Newton finds in them.

Nothing here knows how an engine counts its coordinates: a pose is reached from home by the engine's own
Jacobians and its own integration of velocities.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

LEGS = range(1, 7)
ACTUATORS = [f"leg{i}_actuator" for i in LEGS]
TIPS = [f"leg{i}_tip" for i in LEGS]
ANCHORS = [f"platform_anchor{i}" for i in LEGS]


@dataclass
class Reading:
    """What an engine says at one configuration, world axes.

    `tips` and `anchors` (6, 3); `rotation` and `position` of the platform; Jacobians of all these points
    (6, 3, nv), (3, nv) and of the platform's angular velocity; `strokes` (6,) of the actuators.
    """

    tips: np.ndarray
    anchors: np.ndarray
    position: np.ndarray
    rotation: np.ndarray
    tip_jacobians: np.ndarray
    anchor_jacobians: np.ndarray
    platform_jacobian: np.ndarray
    strokes: np.ndarray
    com: np.ndarray
    mass_matrix: np.ndarray

    def system(self):
        """The platform's velocity over those of the loops' gaps (24, nv)."""
        closures = (self.tip_jacobians - self.anchor_jacobians).reshape(18, -1)
        return np.vstack([self.platform_jacobian, closures])


def put(reader, position, rotation, steps=40):
    """Moves the mechanism there with its loops closed, by Newton's method; returns the reading there."""
    for _ in range(steps):
        now = reader.read()
        turn = Rotation.from_matrix(rotation @ now.rotation.T).as_rotvec()
        wanted = np.concatenate([position - now.position, turn, (now.anchors - now.tips).ravel()])
        step = np.linalg.lstsq(now.system(), wanted, rcond=1e-10)[0]
        # Angles far from the pose are cut: a ball made of three revolute joints has no place for a full step.
        reader.move(step * min(1.0, 0.5 / np.abs(step).max()))
    return reader.read()


class PinocchioReader:
    """Any Pinocchio model with the frames of the exports."""

    def __init__(self, model):
        import pinocchio as pin

        self.pin, self.model, self.data, self.q = pin, model, model.createData(), pin.neutral(model)
        self.mass = sum(inertia.mass for inertia in list(model.inertias)[1:])
        joints = [model.joints[model.getJointId(name)] for name in ACTUATORS]
        self.actuated, self._strokes = [j.idx_v for j in joints], [j.idx_q for j in joints]
        self.gravity = model.gravity.linear

    @classmethod
    def of_urdf(cls, path):
        import pinocchio as pin

        return cls(pin.buildModelFromUrdf(str(path)))

    @classmethod
    def of_mjcf(cls, path):
        import pinocchio as pin

        return cls(pin.buildModelAndConstraintsFromMJCF(str(path))[0])

    def move(self, step):
        self.q = self.pin.integrate(self.model, self.q, step)

    def read(self):
        pin, model, data = self.pin, self.model, self.data
        pin.computeJointJacobians(model, data, self.q)
        pin.updateFramePlacements(model, data)
        com = np.array(pin.centerOfMass(model, data, self.q))
        tree = np.array(pin.crba(model, data, self.q))

        def at(names):
            return np.array([data.oMf[model.getFrameId(name)].translation for name in names])

        def jacobians(names):
            frames = [model.getFrameId(name) for name in names]
            return np.array([pin.getFrameJacobian(model, data, f, pin.LOCAL_WORLD_ALIGNED) for f in frames])

        platform = data.oMf[model.getFrameId("platform")]
        return Reading(
            at(TIPS), at(ANCHORS), platform.translation.copy(), platform.rotation.copy(),
            jacobians(TIPS)[:, :3], jacobians(ANCHORS)[:, :3], jacobians(["platform"])[0],
            self.q[self._strokes], com, np.triu(tree) + np.triu(tree, 1).T,
        )  # fmt: skip


class MujocoReader:
    """MJCF in MuJoCo."""

    def __init__(self, path):
        import mujoco

        self.mujoco = mujoco
        self.model = mujoco.MjModel.from_xml_path(str(path))
        self.data = mujoco.MjData(self.model)
        self.mass = self.model.body_mass.sum()
        joints = [self.model.joint(name) for name in ACTUATORS]
        self.actuated, self._strokes = [j.dofadr[0] for j in joints], [j.qposadr[0] for j in joints]
        self.gravity = self.model.opt.gravity

    def move(self, step):
        self.mujoco.mj_integratePos(self.model, self.data.qpos, step, 1.0)

    def read(self):
        model, data = self.model, self.data
        self.mujoco.mj_fwdPosition(model, data)

        def jacobians(names):
            found = np.zeros((6, 3, model.nv))
            for k, name in enumerate(names):
                self.mujoco.mj_jacSite(model, data, found[k], None, model.site(name).id)
            return found

        full = np.zeros((model.nv, model.nv))
        self.mujoco.mj_fullM(model, data, full)
        platform, linear, angular = data.body("platform"), np.zeros((3, model.nv)), np.zeros((3, model.nv))
        self.mujoco.mj_jacBody(model, data, linear, angular, platform.id)
        return Reading(
            np.array([data.site(name).xpos for name in TIPS]),
            np.array([data.site(name).xpos for name in ANCHORS]),
            platform.xpos.copy(), platform.xmat.reshape(3, 3).copy(),
            jacobians(TIPS), jacobians(ANCHORS), np.vstack([linear, angular]),
            data.qpos[self._strokes].copy(), data.subtree_com[0].copy(), full,
        )  # fmt: skip


class DartReader:
    """A skeleton in DART; `anchors` (6, 3) are points of the platform where it has no bodies for them."""

    def __init__(self, skeleton, tips, anchors):
        self.skeleton, self.mass = skeleton, skeleton.getMass()
        self.tips = [skeleton.getBodyNode(name) for name in tips]
        self.platform = skeleton.getBodyNode("platform")
        self.anchors = np.asarray(anchors)
        dofs = [skeleton.getDof(name) for name in ACTUATORS]
        self.actuated = [dof.getIndexInSkeleton() for dof in dofs]
        self.gravity = skeleton.getGravity()

    def move(self, step):
        self.skeleton.setVelocities(step)
        self.skeleton.integratePositions(1.0)

    def read(self):
        skeleton = self.skeleton
        pose = self.platform.getTransform().matrix()
        position, rotation = pose[:3, 3], pose[:3, :3]
        linear, angular = self.platform.getLinearJacobian(), self.platform.getAngularJacobian()
        return Reading(
            np.array([tip.getTransform().translation() for tip in self.tips]),
            position + self.anchors @ rotation.T, position, rotation,
            np.array([self._full(tip, tip.getLinearJacobian()) for tip in self.tips]),
            np.array([self._full(self.platform, self.platform.getLinearJacobian(b)) for b in self.anchors]),
            self._full(self.platform, np.vstack([linear, angular])),
            skeleton.getPositions()[self.actuated], skeleton.getCOM(), skeleton.getMassMatrix(),
        )  # fmt: skip

    def _full(self, body, jacobian):
        full = np.zeros((len(jacobian), self.skeleton.getNumDofs()))
        columns = [body.getDependentGenCoordIndex(k) for k in range(body.getNumDependentGenCoords())]
        full[:, columns] = jacobian
        return full


class DrakeReader:
    """A plant in Drake with the names of the SDF."""

    def __init__(self, plant, anchors):
        from pydrake.multibody.tree import JacobianWrtVariable

        self.plant, self.context = plant, plant.CreateDefaultContext()
        self.wrt, self.anchors = JacobianWrtVariable.kV, np.asarray(anchors)
        self.mass = plant.CalcTotalMass(self.context)
        joints = [plant.GetJointByName(name) for name in ACTUATORS]
        self.actuated, self._strokes = (
            [j.velocity_start() for j in joints],
            [j.position_start() for j in joints],
        )
        self.tips = [plant.GetFrameByName(f"leg{i}_upper") for i in LEGS]
        self.platform = plant.GetFrameByName("platform")
        self.gravity = plant.gravity_field().gravity_vector()

    def move(self, step):
        plant, context = self.plant, self.context
        q = plant.GetPositions(context) + plant.MapVelocityToQDot(context, step)
        start = plant.GetBodyByName("platform").floating_positions_start()
        q[start : start + 4] /= np.linalg.norm(q[start : start + 4])
        plant.SetPositions(context, q)

    def read(self):
        plant, at = self.plant, self.context
        world, origin = plant.world_frame(), np.zeros(3)
        pose = self.platform.CalcPoseInWorld(at)

        def jacobian(frame, points):
            found = plant.CalcJacobianTranslationalVelocity(at, self.wrt, frame, points, world, world)
            return found.reshape(-1, 3, plant.num_velocities())

        spatial = plant.CalcJacobianSpatialVelocity(at, self.wrt, self.platform, origin, world, world)
        return Reading(
            np.array([tip.CalcPoseInWorld(at).translation() for tip in self.tips]),
            pose.translation() + self.anchors @ pose.rotation().matrix().T,
            pose.translation(), pose.rotation().matrix(),
            np.array([jacobian(tip, origin[:, None])[0] for tip in self.tips]),
            jacobian(self.platform, self.anchors.T), np.vstack([spatial[3:], spatial[:3]]),
            plant.GetPositions(at)[self._strokes], plant.CalcCenterOfMassPositionInWorld(at),
            plant.CalcMassMatrix(at),
        )  # fmt: skip
