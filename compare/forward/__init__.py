"""Engines of forward dynamics by name, one file each; each library is imported in its own file."""

from __future__ import annotations

from compare.registry import Entry

FORWARD: dict[str, Entry] = {
    "closed-form": Entry("compare.forward.closed_form", "ClosedForm", "numpy", "numpy"),
    "pinocchio": Entry("compare.forward.pinocchio", "Pinocchio", "pinocchio", "pin"),
    "mujoco": Entry("compare.forward.mujoco", "Mujoco", "mujoco", "mujoco", "mujoco"),
    "exudyn": Entry("compare.forward.exudyn", "Exudyn", "exudyn", "exudyn", "exudyn"),
}
