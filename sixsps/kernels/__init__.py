"""Machine code from the symbolic model: CasADi's graph, lowered by Numba to SIMD instructions.

`graph.py` reads the instructions of a function of `sixsps.symbolic`; `emission.py` writes them out as
straight-line vector code, one sample a lane; `compiled.py` has Numba compile the loops around it and keep
the machine code on disk; `model.py` is what `sixsps.compile` returns. No C compiler, no second model.

Forward kinematics has no closed form that could be lowered: `pose_equations.py` and `forward_kinematics.py`
are written by hand for Numba (`entries.py`), `poses.py` shares a trajectory among threads (`sharing.py`).

What made it fast: the model leg by leg (4900 operations of J and C became 1200), reciprocals shared, sums
of products fused, parameters taken out of the loop, a solve without roots and branches, threads that start
at once; for derivatives, what a leg takes along its own line left out of the solve, and a loop over the legs.

What did not help on the machine it was measured on (Zen 3, 256-bit vectors): two vectors at a time, constants
spread over vectors beforehand, orders of instructions by critical path or by registers in use instead of
LLVM's own, cutting the code into segments that each pass over several vectors, Householder's reflections or
a pivoting elimination by selects for the solve (as fast within the noise, with roots or branches).
"""
