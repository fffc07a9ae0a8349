"""The model as C99 for controllers: the expressions by CasADi's code generator, plain functions around them.

CasADi writes functions that take pointers to pointers and work space, and a dozen more that describe
them. Only their expressions are kept, and every word in these is checked. The functions around them have
plain arguments, and write results only where all of these can be relied on; `c_header.py` describes them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from itertools import product

import casadi as ca

from sixsps import symbolic
from sixsps.errors import EngineError
from sixsps.parameters import MOTION_COLUMNS, PARAMETERS
from sixsps.singularity import REGULAR_CONDITION
from sixsps.symbolic.c_header import HEADER, comment, declaration, header_text, versions

_REGULARITY = "regularity"

_BODY = re.compile(r"^static int casadi_f0\([^)]*\) \{\n(.*?)\n  return 0;\n\}$", re.MULTILINE | re.DOTALL)
_READ = re.compile(r"arg\[(\d+)\]\? arg\[\1\]\[(\d+)\] : 0")
_WRITE = re.compile(r"if \(res\[0\]!=0\) res\[0\]\[(\d+)\]=")
_VARIABLE = re.compile(r"a\d+")
_WORDS = {"casadi_real": "double", "casadi_sq": "square", "casadi_fmin": "smaller"}


@dataclass(frozen=True, eq=False)
class _Exported:
    """A function of `sixsps.symbolic` as it is called in C.

    Attributes:
        name: in C.
        function: makes it.
        outputs: names in C of its outputs but for the regularity, in order.
        about: what it is for.
    """

    name: str
    function: Callable[[], ca.Function]
    outputs: tuple[str, ...]
    about: str

    @cached_property
    def flat(self) -> ca.Function:
        """The function from one array an input to all its outputs in one column, matrices row by row."""
        given, inputs = {"parameters": ca.SX.sym("parameters", len(PARAMETERS))}, []
        function = self.function()
        for name in function.name_in():
            arrays = MOTION_COLUMNS.get(name, ())
            given |= {array: ca.SX.sym(array, width) for array, width in arrays}
            parts = [array for array, _ in arrays] or [name]
            inputs.append(ca.vertcat(*(given[part] for part in parts)))
        values = ca.vertcat(*(ca.vec(output.T) for output in function.call(inputs)))
        return ca.Function("values", list(given.values()), [values], list(given), ["values"])

    @property
    def inputs(self) -> dict[str, int]:
        """Array -> its size."""
        return {name: self.flat.size1_in(name) for name in self.flat.name_in()}

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Output -> its shape in C."""
        sizes = (self.function().size_out(k) for k in range(len(self.outputs)))
        return {
            name: (rows, columns) if columns > 1 else (rows,)
            for name, (rows, columns) in zip(self.outputs, sizes, strict=True)
        }

    @property
    def count(self) -> int:
        """Number of its values, the regularity last."""
        return int(self.flat.numel_out(0))

    @property
    def signature(self) -> str:
        """The declaration in C, without what ends it."""
        given = [f"const double {name}[{size}]" for name, size in self.inputs.items()]
        found = [f"double {name}{_brackets(shape)}" for name, shape in self.shapes.items()]
        return f"int {self.name}(\n    {_listed(given + found)})"

    @property
    def declaration(self) -> str:
        """What the header says of it."""
        return declaration(self.signature, self.about, (*self.inputs, *self.outputs))

    @property
    def kilobytes(self) -> int:
        """Of stack: all variables and values at once, twice over for what a compiler adds."""
        return -(-2 * 8 * (int(self.flat.sz_w()) + self.count) // 1024)


_FORCES = _Exported(
    "hexapod_leg_forces",
    symbolic.forces,
    ("forces",),
    "Inverse dynamics: the leg forces that a motion takes.",
)
_MOTION = _Exported(
    "hexapod_leg_motion",
    symbolic.leg_motion,
    ("lengths", "length_rates", "length_accelerations"),
    "Inverse kinematics: lengths of the legs and their derivatives. Of the parameters it reads the joints "
    "alone. No pose is singular for it: it returns HEXAPOD_OK or HEXAPOD_NOT_FINITE.",
)
_DERIVATIVES = _Exported(
    "hexapod_leg_force_derivatives",
    symbolic.force_derivatives,
    ("forces", "by_pose", "by_twist", "by_acceleration", "by_wrench"),
    "Leg forces and their exact derivatives, a row a leg. by_pose: the pose is perturbed to (position + dp, "
    "exp([dtheta]x) R), world axes, R being its rotation matrix, and all else keeps its components.",
)


def source(derivatives: bool = False) -> str:
    """Returns `hexapod.c`, the same for every mechanism.

    Args:
        derivatives: whether it also has the derivatives of the forces.

    Raises:
        EngineError: CasADi writes C that this module does not know.
    """
    parts = [comment(f"Written by {versions()}. {HEADER} says what it does."), _PREAMBLE]
    for one in _exported(derivatives):
        parts += [_values(one), _definition(one)]
    return "\n".join(parts)


def header(derivatives: bool = False) -> str:
    """Returns `hexapod.h`, the same for every mechanism; `derivatives` as for `source`."""
    functions = _exported(derivatives)
    return header_text([one.declaration for one in functions], max(one.kilobytes for one in functions))


def _exported(derivatives: bool) -> tuple[_Exported, ...]:
    return (_FORCES, _MOTION, _DERIVATIVES) if derivatives else (_FORCES, _MOTION)


def _values(one: _Exported) -> str:
    """Returns the C function of all values of a function, its expressions as CasADi writes them."""
    generator = ca.CodeGenerator("hexapod", {"verbose": False})
    generator.add(one.flat)
    found = _BODY.search(generator.dump())
    names = list(one.inputs)
    body = _READ.sub(lambda read: f"{names[int(read[1])]}[{read[2]}]", found[1] if found else "nothing")
    body = _WRITE.sub(r"values[\1]=", body)
    body = re.sub(r"\w+", lambda word: _WORDS.get(word[0], word[0]), body)
    _check(body, {*names, "values", "sqrt", *_WORDS.values()})
    arguments = [f"const double *{name}" for name in names] + ["double *values"]
    return f"static void {one.name}_values(\n    {_listed(arguments)})\n{{\n{body}\n}}\n"


def _check(body: str, known: set[str]) -> None:
    """Raises EngineError where there is a word that is neither known nor a variable."""
    words = {word for word in re.findall(r"\b[A-Za-z_]\w*", body) if not _VARIABLE.fullmatch(word)}
    if words - known:
        strange = " ".join(sorted(words - known))
        raise EngineError(f"CasADi {version('casadi')} writes C that this sixsps does not know: {strange}")


def _definition(one: _Exported) -> str:
    """Returns the C function that a user calls."""
    call = f"{one.name}_values(\n        {_listed([*one.inputs, 'values'], 8)});"
    lines = [f"double values[{one.count}];", "", call]
    if one.function().name_out()[-1] == _REGULARITY:
        lines += [
            f"if (!(values[{one.count - 1}] >= {REGULAR_CONDITION**-2:.0e}))",
            "    return HEXAPOD_NOT_REGULAR;",
        ]
    lines += [f"if (!all_finite(values, {one.count}))", "    return HEXAPOD_NOT_FINITE;"]
    # One by one: of a loop, compilers make a call of memcpy.
    entries = [
        name + _brackets(indices)
        for name, shape in one.shapes.items()
        for indices in product(*map(range, shape))
    ]
    lines += [f"{entry} = values[{place}];" for place, entry in enumerate(entries)]
    body = "\n".join(f"    {line}".rstrip() for line in [*lines, "return HEXAPOD_OK;"])
    return f"{one.signature}\n{{\n{body}\n}}\n"


def _listed(arguments: Iterable[str], indent: int = 4) -> str:
    return (",\n" + " " * indent).join(arguments)


def _brackets(numbers: tuple[int, ...]) -> str:
    return "".join(f"[{number}]" for number in numbers)


_PREAMBLE = f"""\
#include "{HEADER}"

#include <float.h>
#include <math.h>

#if DBL_MANT_DIG < 53
#error "double is too short: look for an option of the compiler that makes it 64 bits"
#endif
#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
#error "compile without -ffast-math: what is not a number has to be told from what is"
#endif

static double square(double x)
{{
    return x * x;
}}

/* A NaN on the left stays, unlike in fmin. */
static double smaller(double x, double y)
{{
    return y < x ? y : x;
}}

static int all_finite(const double *values, int count)
{{
    double sum = 0.0;
    int i;

    for (i = 0; i < count; i++)
        sum += values[i] - values[i];
    return sum == 0.0;
}}
"""
