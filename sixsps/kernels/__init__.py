"""Machine code from the symbolic model: CasADi's graph, lowered by Numba to SIMD instructions.

`graph.py` reads the instructions of a function of `sixsps.symbolic`; `emission.py` writes them out as
straight-line vector code; `compiled.py` has Numba compile the loops around it and keep the machine code
on disk; `model.py` is what `sixsps.compile` returns. No C compiler is needed, and no second model.
"""
