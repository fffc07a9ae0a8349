"""How the legs are jointed to the base."""

from __future__ import annotations

from enum import StrEnum


class Legs(StrEnum):
    """Joints of a leg, from base to platform: S spherical, P prismatic, U universal.

    An SPS leg can turn about its own axis and, symmetric about it, does not; a UPS leg is made to
    turn by its universal joint, which takes a moment from it.
    """

    sps = "sps"
    ups = "ups"
