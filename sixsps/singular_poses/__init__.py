"""Singular poses: the set of them, the nearest one to a pose, and where a motion crosses it."""
