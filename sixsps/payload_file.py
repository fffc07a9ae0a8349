"""Payload files: YAML with the mass properties of a rigid body in the platform frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydantic import Field, ValidationError

from sixsps.errors import MechanismError
from sixsps.files import read_bytes
from sixsps.payload import Payload
from sixsps.yaml_reader import read_document
from sixsps.yaml_schema import Inertia, Number, Section, Vector, explained, located

# Ten numbers, however they are laid out and commented.
_LARGEST_FILE = 64 * 1024


class _File(Section):
    mass: Number
    com: Vector = Field(default=[0.0, 0.0, 0.0])
    inertia: Inertia


def load(path: Path) -> Payload:
    """Reads a payload; see `Payload.load`.

    Raises:
        MechanismError: naming file and line, key, value and what is allowed.
    """
    return parse(read_bytes(path, "payload", MechanismError, _LARGEST_FILE), str(path), path.stem)


def parse(content: bytes, source: str, name: str = "payload") -> Payload:
    """Returns the payload that the YAML text `content` describes.

    Args:
        content: UTF-8 YAML.
        source: what to call it in errors.
        name: of the payload.

    Raises:
        MechanismError: naming `source` and line, key, value and what is allowed.
    """
    document = read_document(content, source)
    try:
        return _payload(_File.model_validate(document.content), name)
    except ValidationError as error:
        raise explained(error, document, lambda path: Inertia if path else _File) from None
    except MechanismError as error:
        raise located(error, document) from None


def _payload(file: _File, name: str) -> Payload:
    return Payload(file.mass, np.array(file.com), file.inertia.matrix, name)
