"""What the figures were measured on, and how busy others kept it meanwhile."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any

from benchmarks.workers import processors
from compare.facts import versions
from sixsps.kernels.compiled import source_digest
from sixsps.kernels.emission import host_width

_COMPILERS = ("numba", "llvmlite")
_SUPPOSED_CACHE = 32 * 2**20
_PROC = Path("/proc")
_CACHES = Path("/sys/devices/system/cpu/cpu0/cache")
_UNITS = {"K": 2**10, "M": 2**20}


def facts() -> dict[str, Any]:
    """Returns the machine, the versions and the date."""
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "processor": _processor(),
        "architecture": platform.machine(),
        "system": f"{platform.system()} {platform.release()}",
        "processors": processors(),
        "vector_bits": 64 * host_width(),
        "last_cache_bytes": last_cache(),
        "memory_bytes": _memory("MemTotal"),
        "versions": versions() | {name: version(name) for name in _COMPILERS},
        "sources": source_digest(),
    }


def last_cache() -> int:
    """Returns the size of the largest cache of a processor in bytes; 32 MiB where nothing tells."""
    sizes = [path.read_text().strip() for path in _CACHES.glob("index*/size")]
    found = [int(size[:-1]) * _UNITS[size[-1]] for size in sizes if size[-1:] in _UNITS]
    return max(found, default=_SUPPOSED_CACHE)


def memory_left() -> int | None:
    """Returns how many bytes may still be taken without swapping, None where nothing tells."""
    return _memory("MemAvailable")


@dataclass
class Watch:
    """How busy the machine was, from now until `disturbance` is asked for."""

    _start: float = field(default_factory=perf_counter)
    _own: float = field(default_factory=lambda: _own_seconds())
    _all: dict[str, float] | None = field(default_factory=lambda: _processor_seconds())
    _load: list[float] | None = field(default_factory=lambda: _load_average())

    def disturbance(self) -> dict[str, Any]:
        """Returns load averages before and after, and the shares of all processors that others took.

        `others_share` is of other processes of this machine, `stolen_share` of other machines on the
        same host; None where the system does not tell.
        """
        elapsed, own, now = perf_counter() - self._start, _own_seconds() - self._own, _processor_seconds()
        found = {
            "seconds": elapsed,
            "load_average_before": self._load,
            "load_average_after": _load_average(),
            "others_share": None,
            "stolen_share": None,
        }
        if self._all and now:
            capacity = elapsed * (os.cpu_count() or 1)
            found["others_share"] = max(0.0, now["busy"] - self._all["busy"] - own) / capacity
            found["stolen_share"] = (now["stolen"] - self._all["stolen"]) / capacity
        return found


def _processor() -> str:
    source = _PROC / "cpuinfo"
    lines = source.read_text().splitlines() if source.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _memory(key: str) -> int | None:
    source = _PROC / "meminfo"
    lines = source.read_text().splitlines() if source.exists() else []
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith(f"{key}:")), None)


def _load_average() -> list[float] | None:
    return list(os.getloadavg()) if hasattr(os, "getloadavg") else None


def _own_seconds() -> float:
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def _processor_seconds() -> dict[str, float] | None:
    """Returns seconds since boot in which processors were busy or stolen, all processors together."""
    source = _PROC / "stat"
    if not source.exists():
        return None
    ticks = [
        int(word) / os.sysconf("SC_CLK_TCK") for word in source.read_text().split("\n", 1)[0].split()[1:9]
    ]
    user, nice, system, _idle, _waiting, hardware, software, stolen = ticks
    return {"busy": user + nice + system + hardware + software, "stolen": stolen}
