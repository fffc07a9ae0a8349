"""Engines that cannot share the tests' process: a class that has one computed in another.

OpenSim and CasADi each bring a library libcasadi.so.3.7, of different content; once one is loaded, the
other package does not import.
"""

from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context

from compare import registry

APART = {"opensim"}


@cache
def _pool():
    return ProcessPoolExecutor(1, mp_context=get_context("spawn"))


def load(name):
    """The class of an engine, or one that stands for it and computes in another process."""
    if name not in APART:
        return registry.load(name)
    facts = _pool().submit(_facts, name).result()

    class Apart:
        formulation, loops, shares = facts[:3]

        def __init__(self, mechanism):
            self.mechanism = mechanism

        @staticmethod
        def version():
            return facts[3]

        def inverse_dynamics(self, motion, progress):
            result, seen = _pool().submit(_compute, name, self.mechanism, motion).result()
            for done in seen:
                progress(done)
            return result

    return Apart


def _facts(name):
    engine = registry.load(name)
    return engine.formulation, engine.loops, engine.shares, engine.version()


def _compute(name, mechanism, motion):
    seen = []
    return registry.load(name)(mechanism).inverse_dynamics(motion, seen.append), seen
