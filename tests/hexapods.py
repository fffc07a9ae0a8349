"""Hexapods and poses that tests of assembly modes draw from, and poses found by brute force."""

from pathlib import Path

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from sixsps.assembly.solve import modes_of

DIETMAIER = Path(__file__).parents[2] / "shared" / "data" / "dietmaier1998.yaml"


def dietmaier():
    """(base, platform, lengths) of the platform with 40 real poses."""
    # Dietmaier, "The Stewart-Gough platform of general geometry can have 40 real postures" (1998)
    base = [
        [0.0, 0.0, 0.0],
        [1.107915, 0.0, 0.0],
        [0.549094, 0.756063, 0.0],
        [0.735077, -0.223935, 0.525991],
        [0.514188, -0.526063, -0.368418],
        [0.590473, 0.094733, -0.205018],
    ]
    platform = [
        [0.0, 0.0, 0.0],
        [0.542805, 0.0, 0.0],
        [0.956919, -0.528915, 0.0],
        [0.665885, -0.353482, 1.402538],
        [0.478359, 1.158742, 0.107672],
        [-0.137087, -0.235121, 0.353913],
    ]
    return (
        np.array(base),
        np.array(platform),
        np.array([1.0, 0.645275, 1.086284, 1.503439, 1.281933, 0.771071]),
    )


def published():
    """The same, as it lies beside the checkout."""
    data = yaml.safe_load(DIETMAIER.read_text())
    return tuple(np.array(data[key]) for key in ("base_anchors", "platform_anchors", "leg_lengths"))


def lengths(base, platform, position, rotation):
    return np.linalg.norm(position + platform @ rotation.T - base, axis=1)


class Hexapod:
    """A random mechanism in a random pose.

    Args:
        rng: source of everything.
        base: which legs share base anchors, six numbers.
        platform: which share platform anchors.
        flat: "", "base" or "both": what is planar.
    """

    def __init__(self, rng, base=range(6), platform=range(6), flat=""):
        self.base = rng.uniform(-1, 1, (6, 3))[list(base)]
        self.platform = rng.uniform(-1, 1, (6, 3))[list(platform)]
        if flat:
            self.base[:, 2] = 0
        if flat == "both":
            self.platform[:, 2] = 0
        self.rotation = Rotation.random(rng=rng).as_matrix()
        self.position = rng.uniform(-1, 1, 3)

    @property
    def lengths(self):
        return lengths(self.base, self.platform, self.position, self.rotation)

    def modes(self):
        return modes_of(self.base, self.platform, self.lengths)


def distance(modes, position, rotation):
    """How far the nearest mode is from a pose, positions and matrix entries together."""
    apart = np.linalg.norm(modes.position - position, axis=1)
    return (apart + np.abs(modes.rotation - rotation).max(axis=(1, 2), initial=0)).min(initial=np.inf)


def same_poses(one, other):
    """How far two sets of poses (positions, rotations) of one size are apart, pairing the nearest."""
    assert len(one[0]) == len(other[0])
    far = [
        (np.linalg.norm(other[0] - p, axis=1) + np.abs(other[1] - R).max(axis=(1, 2), initial=0)).min()
        for p, R in zip(*one, strict=True)
    ]
    return max(far, default=0.0)


def newton_poses(base, platform, given, starts, rng):
    """Positions (n, 3) and rotations (n, 3, 3) that Newton's method on SE(3) finds from random starts."""
    size = given.max()
    position = rng.uniform(-size, size, (starts, 3))
    rotation = Rotation.random(starts, rng=rng).as_matrix()
    with np.errstate(all="ignore"):
        for _ in range(60):
            arms = platform @ rotation.transpose(0, 2, 1)
            legs = position[:, None] + arms - base
            error = (np.sum(legs**2, axis=-1) - given**2) / 2
            jacobian = np.concatenate([legs, np.cross(arms, legs)], axis=-1)
            usable = np.abs(np.linalg.det(jacobian)) > 1e-200
            step = np.zeros((starts, 6))
            step[usable] = np.linalg.solve(jacobian[usable], -error[usable, :, None])[..., 0]
            length = np.linalg.norm(step, axis=1, keepdims=True)
            step *= np.minimum(1, size / np.maximum(length, 1e-300))  # far steps lead nowhere
            position = position + step[:, :3]
            rotation = Rotation.from_rotvec(step[:, 3:]).as_matrix() @ rotation
    arms = platform @ rotation.transpose(0, 2, 1)
    found = np.linalg.norm(position[:, None] + arms - base, axis=-1)
    good = np.abs(found - given).max(axis=1) < 1e-11 * size
    return position[good], rotation[good]
