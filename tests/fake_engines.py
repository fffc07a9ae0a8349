"""Engines that misbehave, for the runner's tests; run in worker processes."""

import os
import signal
import subprocess
import sys
import time

import numpy as np

from compare.engine import EngineForces


class _Fake:
    formulation = loops = shares = "none"

    def __init__(self, mechanism):
        self.mechanism = mechanism

    @staticmethod
    def version():
        return "fake 1"


class Killed(_Fake):
    def inverse_dynamics(self, motion, progress):
        os.kill(os.getpid(), signal.SIGSEGV)


class SleepsForEver(_Fake):
    def inverse_dynamics(self, motion, progress):
        time.sleep(3600)


class StartsForEver(_Fake):
    def __init__(self, mechanism):
        time.sleep(3600)


class PrintsGarbage(_Fake):
    def inverse_dynamics(self, motion, progress):
        os.write(1, b"\xff\x00garbage {]" * 100_000)
        print("more", file=sys.stderr)
        return EngineForces(np.ones((len(motion), 6)))


class Raises(_Fake):
    def inverse_dynamics(self, motion, progress):
        raise ValueError("joint 7\nis not\nthere")


class Leaves(_Fake):
    def inverse_dynamics(self, motion, progress):
        print("license expired", file=sys.stderr)
        sys.exit(3)


class GivesNan(_Fake):
    def inverse_dynamics(self, motion, progress):
        forces = np.zeros((len(motion), 6))
        forces[1, 2] = np.nan
        return EngineForces(forces)


class GivesTooFew(_Fake):
    def inverse_dynamics(self, motion, progress):
        return EngineForces(np.zeros((len(motion) - 1, 6)))


class Disagrees(_Fake):
    """Kane's forces, one of them 1 % off."""

    def inverse_dynamics(self, motion, progress):
        from sixsps.formulations import inverse_dynamics

        forces = inverse_dynamics(self.mechanism, motion)
        forces[3, 4] *= 1.01
        return EngineForces(forces)


class GivesComplexNumbers(_Fake):
    def inverse_dynamics(self, motion, progress):
        return EngineForces(np.ones((len(motion), 6)) + 1j)


class GivesOneClosure(_Fake):
    def inverse_dynamics(self, motion, progress):
        return EngineForces(np.ones((len(motion), 6)), np.float64(0), np.float64(0))


class DiesOfARareSignal(_Fake):
    def inverse_dynamics(self, motion, progress):
        os.kill(os.getpid(), signal.SIGRTMIN + 6)


class SaysWhatNoFileCanHold(_Fake):
    def inverse_dynamics(self, motion, progress):
        raise ValueError("half of \udcff")


class OddWords(_Fake):
    formulation = None

    @staticmethod
    def version():
        return 4

    def inverse_dynamics(self, motion, progress):
        progress(4.5)
        return EngineForces(np.ones((len(motion), 6), dtype=np.float32))


class LeavesAChild(_Fake):
    def inverse_dynamics(self, motion, progress):
        child = subprocess.Popen(["sleep", "777"])
        with open(os.environ["SIXSPS_TEST_PID"], "w") as file:  # noqa: PTH123
            file.write(str(child.pid))
        time.sleep(3600)
