"""How much is measured: the whole, or a quick run that shows that everything works."""

from __future__ import annotations

from dataclasses import dataclass

MECHANISM, MOTION = "wu2012", "sinusoids"


@dataclass(frozen=True)
class Plan:
    """Sizes and repeats of a run.

    Attributes:
        name: full or quick, for the report.
        rounds: how often each contestant has its turn.
        turn: seconds that a turn takes at least.
        states: pace of a candidate (`candidates.PACES`) -> number of states it goes over.
        calls: pace -> number of single calls that are timed.
        slopes: samples of the derivatives.
        followed: samples of the trajectory that forward kinematics follows.
        poses: of each workspace, that forward kinematics finds.
        sizes: numbers of samples along which the cost per sample is followed.
        memory: pace -> samples of the batch whose memory is measured.
        starts: processes started for a start-up time.
        cold_starts: processes that compile anew.
        beyond_cache: size of an array of the bandwidth loop over the size of the last cache.
        engines: registered engines to compare with.
    """

    name: str
    rounds: int
    turn: float
    states: dict[str, int]
    calls: dict[str, int]
    slopes: int
    followed: int
    poses: int
    sizes: tuple[int, ...]
    memory: dict[str, int]
    starts: int
    cold_starts: int
    beyond_cache: float
    engines: tuple[str, ...] = ()


FULL = Plan(
    name="full",
    rounds=15,
    turn=0.1,
    states={"compiled": 100_000, "arrays": 32_768, "formulation": 2048, "engine": 200},
    calls={"compiled": 300_000, "arrays": 15_000, "formulation": 15_000, "engine": 15_000},
    slopes=10_000,
    followed=10**6,
    poses=10**5,
    sizes=(10**4, 10**5, 10**6, 10**7),
    memory={"compiled": 10**6, "arrays": 10**6, "formulation": 10**5, "engine": 1000},
    starts=15,
    cold_starts=3,
    beyond_cache=4.0,
)
QUICK = Plan(
    name="quick",
    rounds=3,
    turn=0.002,
    states={"compiled": 4096, "arrays": 4096, "formulation": 256, "engine": 16},
    calls={"compiled": 3000, "arrays": 60, "formulation": 60, "engine": 60},
    slopes=256,
    followed=20_000,
    poses=200,
    sizes=(1000, 10_000),
    memory={"compiled": 20_000, "arrays": 20_000, "formulation": 1000, "engine": 16},
    starts=2,
    cold_starts=1,
    beyond_cache=0.25,
)
