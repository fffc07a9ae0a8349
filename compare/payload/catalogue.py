"""The robots of the package example-robot-data by name, and URDF files by path; reads no robot."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from sixsps.errors import MechanismError, UnknownNameError
from sixsps.files import exists

_PACKAGE = "example-robot-data"
_SHOWN = ("panda", "ur5", "xarm7", "talos", "romeo", "icub", "simple_humanoid", "solo12")
# What a robot is called, where its file has another name.
_ALIASES = {
    "g1": "g1_29dof_rev_1_0",
    "hyq": "hyq_no_sensors",
    "talos": "talos_reduced",
    "ur3": "ur3_robot",
    "ur5": "ur5_robot",
    "ur10": "ur10_robot",
}


@dataclass(frozen=True)
class Robot:
    """Where the description of a robot is.

    Attributes:
        name: what to call it.
        urdf: file with its links and joints.
        srdf: file with named configurations of it, None where there is none.
    """

    name: str
    urdf: Path
    srdf: Path | None = None


def robots() -> dict[str, Path]:
    """Returns the URDF files of example-robot-data by name; empty where it is not installed.

    A robot is called after its file; where two files have the same name, with the folder before it.
    """
    files = _files(".urdf")
    occurrences = Counter(file.stem for file in files)
    named = {
        file.stem if occurrences[file.stem] == 1 else f"{_folder(file).name}/{file.stem}": file
        for file in files
    }
    return named | {alias: named[name] for alias, name in _ALIASES.items() if name in named}


def find_robot(name_or_path: str) -> Robot:
    """Returns a robot by its name in example-robot-data or the path of its URDF file.

    Raises:
        MechanismError: there is no such file.
        UnknownNameError: there is no robot of that name.
    """
    path = Path(name_or_path)
    if path.suffix.lower() == ".urdf":
        if not exists(path):
            raise MechanismError("payload", "no such file", "an existing file", name_or_path)
        return Robot(path.stem, path)
    known = robots()
    if name_or_path not in known:
        raise UnknownNameError("payload", name_or_path, _allowed(known))
    urdf = known[name_or_path]
    return Robot(name_or_path, urdf, _configurations_of(urdf))


def _allowed(known: dict[str, Path]) -> str:
    files = "a file (.yaml of a rigid body, .urdf of a robot)"
    if not known:
        return f"{files}; package {_PACKAGE}, which has robots by name, is not installed"
    some = ", ".join(name for name in _SHOWN if name in known)
    return f"{files} or a robot of {_PACKAGE}: {some} or one of {len(known) - len(_SHOWN)} more"


def _configurations_of(urdf: Path) -> Path | None:
    """Returns the SRDF file beside a URDF file with the longest name that its name begins with."""
    beside = [
        srdf for srdf in _files(".srdf") if _folder(srdf) == _folder(urdf) and urdf.stem.startswith(srdf.stem)
    ]
    return max(beside, key=lambda srdf: len(srdf.stem), default=None)


def _folder(file: Path) -> Path:
    """Returns the folder of a robot's description, from a file in one of its subfolders."""
    return file.parents[1]


def _files(suffix: str) -> list[Path]:
    try:
        package = distribution(_PACKAGE)
    except PackageNotFoundError:
        return []
    listed = [file for file in package.files or [] if file.suffix == suffix]
    return sorted(Path(str(file.locate())).resolve() for file in listed)
