"""What the results say besides the engines: the legs along the motion, the inputs, the machine."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from compare import metrics
from sixsps.arrays import Array
from sixsps.kinematics import LegKinematics
from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

_PACKAGES = ("sixsps", "numpy", "scipy", "casadi", "numba", "pin", "xacro", "pyarrow", "python-flint")


def measures(mechanism: Mechanism, motion: Motion, legs: LegKinematics, reference: Array) -> dict[str, Any]:
    """Returns ranges of the legs, the largest condition number, limit violations and power balance.

    Args:
        mechanism: geometry and inertia.
        motion: n samples.
        legs: `inverse_kinematics(mechanism, motion)`.
        reference: (n, 6) forces [N]; NaN at singular samples.
    """
    violations = metrics.limit_violations(legs.lengths, mechanism.length_limits)
    worst = int(np.argmax(legs.condition))
    return {
        "legs": [
            {"leg": leg + 1}
            | _range("length", "m", legs.lengths[:, leg])
            | _range("length_rate", "m_s", legs.length_rates[:, leg])
            | _range("force", "N", reference[:, leg])
            for leg in range(6)
        ],
        "max_condition": {
            "value": metrics.finite_or_none(float(legs.condition[worst])),
            "t": float(motion.time[worst]),
            "characteristic_length_m": mechanism.characteristic_length,
        },
        "limit_violations": [
            {
                "leg": violation.leg + 1,
                "samples": violation.samples,
                "t": float(motion.time[violation.worst_sample]),
                "length_m": violation.length,
                "limit_m": violation.limit,
            }
            for violation in violations
        ],
        **_power_balance(mechanism, motion, legs, reference),
    }


def _power_balance(
    mechanism: Mechanism, motion: Motion, legs: LegKinematics, reference: Array
) -> dict[str, Any]:
    try:
        from sixsps import symbolic
    except Exception as error:  # a broken CasADi must not take the other engines' results along
        why = f"the rate of energy needs CasADi: {type(error).__name__}: {error}"
        return {"power_balance_residual": None, "power_balance_residual_W": None, "power_balance_reason": why}
    rate = symbolic.evaluate(symbolic.energy_rate(), mechanism, motion)["rate"][:, 0]
    balance = metrics.power_balance(mechanism, motion, legs, reference, rate)
    return {
        "power_balance_residual": metrics.finite_or_none(balance.relative),
        "power_balance_residual_W": metrics.finite_or_none(balance.watts),
        "power_balance_reason": "",
    }


def _range(name: str, unit: str, values: Array) -> dict[str, float | None]:
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (None, None)
    return {f"{name}_min_{unit}": low, f"{name}_max_{unit}": high}


def mechanism_facts(mechanism: Mechanism) -> dict[str, Any]:
    """Returns the entry `mechanism` of the results."""
    return {
        "name": mechanism.name,
        "sha256": mechanism.sha256,
        "source": mechanism.source,
        "assumed": dict(mechanism.assumed),
    }


def motion_facts(motion: Motion) -> dict[str, Any]:
    """Returns the entry `motion` of the results."""
    return {
        "name": motion.name,
        "sha256": motion.sha256,
        "samples": len(motion),
        "start_s": float(motion.time[0]),
        "end_s": float(motion.time[-1]),
        "estimated": dict(motion.estimated),
        "changes": list(motion.changes),
    }


def versions() -> dict[str, str]:
    """Returns the versions of Python and of the packages that the core stands on."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def machine() -> dict[str, Any]:
    """Returns what computed: system, architecture and cores."""
    return {
        "system": f"{platform.system()} {platform.release()}",
        "architecture": platform.machine(),
        "cores": os.cpu_count(),
    }
