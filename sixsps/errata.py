"""The misprints of Wu, Xiong & Kong (2012), each with the error that it makes in a stated case."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sixsps.bodies import Platform
from sixsps.certified import certified_inverse_dynamics
from sixsps.files import write_atomically
from sixsps.formulations.wu2012_printed import MISPRINTS, Misprint, inverse_dynamics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion
from sixsps.trajectories import bundled

_SAMPLES = 41
_COM, _MOMENT = (0.02, -0.01, 0.03), (4.0, -3.0, 2.0)
_FILES = ("errata.md", "hexapod.yaml", "motion.csv")
_TEXT = """# Errata of Wu, Xiong & Kong (2012)

“Dynamic analysis of 6-SPS parallel mechanism”. Written by `sixsps errata --output .`

Each error is the largest over all samples and legs, against certified forces up to {largest:.0f} N, when this
misprint alone is put into the corrected equations. The case, in `hexapod.yaml` and `motion.csv` beside this
page: the paper's example with the platform's centre of mass at {com} m, along {samples} samples of the
bundled sinusoids, with a moment of {moment} N m on the platform. The last row is what this command finds:

    sixsps compare hexapod.yaml motion.csv --engine wu2012-printed

{table}

Where the print cannot be evaluated as it stands, it is read as NumPy and MATLAB would compute it: a row
vector that is added to a matrix is added to each of its rows.
"""
_TOGETHER = Misprint("all", "formulation `wu2012-printed`", "formulation `kane`")
_WITHOUT_A_NUMBER = (
    Misprint("14", "headed “up links”", "holds for the lower links"),
    Misprint("C_i", "some rows carry swapped indices", "each row its own leg and link"),
    Misprint(
        "section 5",
        "ε_l, a_d and a_u, used but never given",
        "ε_l = (s × S'' − 2 l' ω_l) / l, a_d = e_d s'', a_u = S'' − e_u s''",
    ),
    Misprint(
        "section 3",
        "leg frames with Y square to the plane O A_i B_i, which spin about s, against eq. 5: ω_l · s = 0",
        "no spin; harmless for links that are symmetric about the leg axis, as the model requires",
    ),
)


@dataclass(frozen=True)
class Erratum:
    """A misprint and its effect.

    Attributes:
        misprint: equation, printed and corrected form.
        newtons: largest error that it makes alone, over all samples and legs [N]; None where it
            changes no number.
    """

    misprint: Misprint
    newtons: float | None


def case() -> tuple[Mechanism, Motion]:
    """Returns the mechanism and the motion in which every misprint makes a difference.

    The paper's example with an off-centre platform, along the bundled sinusoids, with a moment.
    """
    paper = Mechanism.load("wu2012")
    platform = Platform(paper.platform.mass, np.array(_COM), paper.platform.inertia)
    mechanism = replace(paper, name="wu2012 with an off-centre platform", platform=platform)
    motion = bundled("sinusoids", paper, _SAMPLES)
    moment = np.broadcast_to(_MOMENT, (_SAMPLES, 3))
    return mechanism, replace(motion, moment=moment, name="sinusoids with a moment")


def errata() -> list[Erratum]:
    """Returns every misprint with its error against certified forces in `case`, then all together."""
    mechanism, motion = case()
    truth = certified_inverse_dynamics(mechanism, motion)

    def error(*names: str) -> float:
        return float(truth.errors(inverse_dynamics(mechanism, motion, names)).max())

    found = [Erratum(misprint, error(name)) for name, misprint in MISPRINTS.items()]
    found += [Erratum(misprint, None) for misprint in _WITHOUT_A_NUMBER]
    return [*found, Erratum(_TOGETHER, error(*MISPRINTS))]


def markdown() -> str:
    """Returns the table of errata as Markdown."""
    largest = np.abs(certified_inverse_dynamics(*case()).forces).max()
    rows = [
        (erratum.misprint.equation, erratum.misprint.printed, erratum.misprint.corrected, _newtons(erratum))
        for erratum in errata()
    ]
    header = ("equation", "printed", "corrected", "error [N]")
    lines = [header, ("---",) * 3 + ("---:",), *rows]
    table = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    return _TEXT.format(table=table, largest=largest, com=_COM, moment=_MOMENT, samples=_SAMPLES)


def write(folder: Path) -> list[Path]:
    """Writes the table, and the mechanism and the motion of its case, into `folder`.

    Returns:
        Paths of `errata.md`, `hexapod.yaml` and `motion.csv`.

    Raises:
        OutputError: one of them cannot be written.
    """
    table, hexapod, recording = (folder / name for name in _FILES)
    mechanism, motion = case()
    with write_atomically(table) as temporary:
        temporary.write_text(markdown(), encoding="utf-8")
    mechanism.save(hexapod)
    motion.save(recording)
    return [table, hexapod, recording]


def _newtons(erratum: Erratum) -> str:
    return "none" if erratum.newtons is None else f"{erratum.newtons:.3g}"
