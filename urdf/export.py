"""Writing the descriptions of a mechanism to files."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import numpy as np

from sixsps.errors import OutputError
from sixsps.files import exists, output_folder, write_atomically
from sixsps.legs import Legs
from sixsps.mechanism import Mechanism
from urdf.closures import render_closures
from urdf.mjcf import render_mjcf
from urdf.names import file_stem
from urdf.options import Loops
from urdf.render import render_urdf
from urdf.sdf import render_sdf


def export_urdf(mechanism: Mechanism, output: Path, legs: Legs = Legs.sps) -> list[Path]:
    """Writes URDF, the loop closures beside it, and MJCF.

    Args:
        mechanism: geometry and inertia.
        output: folder, made where its parent exists; or the name of the URDF file, beside which
            the others are written.
        legs: joints of the legs.

    Returns:
        Paths of the URDF, the closure YAML and the MJCF.

    Raises:
        InputError: `legs` is none.
        MechanismError: the mechanism is geometry alone.
        OutputError: `output` cannot be written, or a mechanism file has the name of the closure YAML.
    """
    _check_inertia(mechanism)
    description, mjcf = render_urdf(mechanism, legs), render_mjcf(mechanism, legs)
    urdf = _target(mechanism, output, ".urdf")
    contents = {
        urdf: description,
        urdf.with_suffix(".yaml"): render_closures(),
        urdf.with_suffix(".xml"): mjcf,
    }
    return _write(contents)


def export_mjcf(mechanism: Mechanism, output: Path, legs: Legs = Legs.sps) -> list[Path]:
    """Writes MJCF to a folder or, where `output` ends in .xml, to that file; see `export_urdf`."""
    _check_inertia(mechanism)
    text = render_mjcf(mechanism, legs)
    return _write({_target(mechanism, output, ".xml"): text})


def export_sdf(
    mechanism: Mechanism, output: Path, legs: Legs = Legs.sps, loops: Loops = Loops.joints
) -> list[Path]:
    """Writes SDF to a folder or, where `output` ends in .sdf, to that file; see `export_urdf`."""
    text = render_sdf(mechanism, legs, loops)
    return _write({_target(mechanism, output, ".sdf"): text})


def _check_inertia(mechanism: Mechanism) -> None:
    """Raises MechanismError of geometry alone, before its home pose is sought, which takes strokes only."""
    np.asarray(mechanism.gravity)


def _target(mechanism: Mechanism, output: Path, suffix: str) -> Path:
    if output.suffix == suffix and not output.is_dir():
        return output
    return output_folder(output) / (file_stem(mechanism.name) + suffix)


def _write(contents: dict[Path, str]) -> list[Path]:
    """Writes all files or, where one of them cannot be written, none."""
    with ExitStack() as stack:
        for path, text in contents.items():
            if (
                path.suffix == ".yaml"
                and exists(path)
                and "closed_loop" not in path.read_text("utf-8", "replace")
            ):
                found = "a YAML file that holds no closures, perhaps the mechanism"
                raise OutputError("output", found, "a name that is free, or that of closures", str(path))
            stack.enter_context(write_atomically(path)).write_text(text, encoding="utf-8")
    return list(contents)
