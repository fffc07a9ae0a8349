"""Writing the descriptions of a mechanism to files."""

from __future__ import annotations

import re
from contextlib import ExitStack
from pathlib import Path

from sixsps.errors import OutputError
from sixsps.files import exists, output_folder, write_atomically
from sixsps.legs import Legs
from sixsps.mechanism import Mechanism
from urdf.closures import render_closures
from urdf.mjcf import render_mjcf
from urdf.render import render_urdf

_LONGEST_STEM = 60


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
        OutputError: `output` cannot be written, or a mechanism file has the name of the closure YAML.
    """
    urdf = _target(mechanism, output, ".urdf")
    contents = {
        urdf: render_urdf(mechanism, legs),
        urdf.with_suffix(".yaml"): render_closures(),
        urdf.with_suffix(".xml"): render_mjcf(mechanism, legs),
    }
    return _write(contents)


def export_mjcf(mechanism: Mechanism, output: Path, legs: Legs = Legs.sps) -> list[Path]:
    """Writes MJCF to a folder or, where `output` ends in .xml, to that file; see `export_urdf`."""
    return _write({_target(mechanism, output, ".xml"): render_mjcf(mechanism, legs)})


def file_stem(name: str) -> str:
    """Returns a file name for a mechanism: no separators, no leading dot, nothing a shell expands."""
    stem = re.sub(r"[^A-Za-z0-9._-]+", "_", name).strip("._")[:_LONGEST_STEM]
    return stem or "hexapod"


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
