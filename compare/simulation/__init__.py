"""Simulation: leg forces put into forward dynamics, to see whether the planned motion comes out."""
