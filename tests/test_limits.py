"""Limits of a mechanism: what may be given, and how it is kept."""

import math
import pickle
from dataclasses import FrozenInstanceError, fields, replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sixsps.errors import MechanismError
from sixsps.limits import Limits
from sixsps.mechanism import Mechanism
from sixsps.mechanism_file import parse

WU = Mechanism.load("wu2012")
AXES = np.random.default_rng(3).standard_normal((6, 3))
FULL = Limits(
    force=[[-k, 2 * k + 1] for k in range(6)],
    rate=0.5,
    base_cone=[0.1, 0.2, 0.3, 0.4, 0.5, 0.6],
    base_axes=AXES,
    platform_cone=math.pi,
    platform_axes=-AXES,
    clearance=0.02,
)


def test_one_value_is_that_of_all_legs():
    assert_array_equal(Limits(force=(-5, 7)).force, [[-5, 7]] * 6)
    assert_array_equal(Limits(rate=0.5).rate, [0.5] * 6)
    assert_array_equal(Limits(platform_cone=1).platform_cone, [1] * 6)


def test_nothing_is_limited_unless_it_is_given():
    assert not Limits()
    assert Limits().to_mapping() == {}
    assert not WU.limits
    assert all(Limits(**{name: value}) for name, value in FULL.to_mapping().items() if "axes" not in name)


def test_limits_survive_a_mechanism_file(tmp_path):
    mechanism = replace(WU, limits=FULL)
    mechanism.save(tmp_path / "limited.yaml")
    again = Mechanism.load(tmp_path / "limited.yaml")
    assert again == mechanism
    for field in fields(Limits):
        assert_array_equal(getattr(again.limits, field.name), getattr(FULL, field.name))


def test_limits_belong_to_the_hash_where_there_are_any():
    assert replace(WU, limits=FULL).sha256 != WU.sha256
    assert replace(WU, limits=Limits()).sha256 == WU.sha256


def test_limits_are_frozen_copies():
    axes = AXES.copy()
    limits = Limits(base_cone=1.0, base_axes=axes)
    axes[0] = 0
    assert_array_equal(limits.base_axes, AXES)
    with pytest.raises(ValueError, match="read-only"):
        limits.base_axes[0] = 0
    with pytest.raises(FrozenInstanceError):
        limits.rate = 1


def test_come_back_from_a_pickle_equal_and_frozen():
    for again in (
        pickle.loads(pickle.dumps(FULL)),
        pickle.loads(pickle.dumps(replace(WU, limits=FULL))).limits,
    ):
        assert again == FULL
        assert hash(again) == hash(FULL)
        with pytest.raises(ValueError, match="read-only"):
            again.base_axes[0] = 0
    assert Limits(rate=0.5) == Limits(rate=[0.5] * 6)
    assert Limits(rate=0.5) != Limits(rate=0.6)
    assert Limits() != "none"


REFUSED = {
    "force backwards": ("force", "[5, -5]", "least < largest [N]"),
    "force scalar": ("force", "5", "shape (6, 2)"),
    "force of five": ("force", "[[0, 1], [0, 1], [0, 1], [0, 1], [0, 1]]", "shape (6, 2)"),
    "force text": ("force", "much", "numbers of shape"),
    "force infinite": ("force", "[-.inf, 5]", "finite"),
    "rate zero": ("rate", "0", "> 0 [m/s]"),
    "rate of two": ("rate", "[1, 2]", "shape (6)"),
    "rate true": ("rate", "true", "a number"),
    "cone zero": ("base_cone", "0", "above 0 and at most pi"),
    "cone in degrees": ("platform_cone", "30", "above 0 and at most pi"),
    "axes alone": ("base_axes", str([[0, 0, 1]] * 6), "with base_cone"),
    "one axis": ("platform_axes", "[0, 0, 1]", "shape (6, 3)"),
    "clearance negative": ("clearance", "-0.1", "> 0 [m]"),
    "clearance each": ("clearance", "[1, 1, 1, 1, 1, 1]", "shape ()"),
    "unknown": ("froce", "[0, 1]", "the keys force, rate"),
}  # fmt: skip


@pytest.mark.parametrize(("key", "value", "allowed"), REFUSED.values(), ids=REFUSED)
def test_a_file_with_a_wrong_limit_is_refused_with_its_line(key, value, allowed, tmp_path):
    WU.save(tmp_path / "wu.yaml")
    text = (tmp_path / "wu.yaml").read_text() + f"limits:\n  {key}: {value}\n"
    with pytest.raises(MechanismError) as caught:
        parse(text.encode(), "wu.yaml")
    assert caught.value.place.startswith(f"limits.{key}")
    assert allowed in caught.value.allowed
    assert caught.value.source == f"wu.yaml:{len(text.splitlines())}"


def test_an_axis_has_a_length():
    with pytest.raises(MechanismError, match=r"limits\.base_axes"):
        Limits(base_cone=1.0, base_axes=np.vstack([AXES[:5], np.zeros(3)]))
