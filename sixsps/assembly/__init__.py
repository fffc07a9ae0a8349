"""All assembly modes of a hexapod: every pose in which the legs have given lengths, with proofs."""

from sixsps.assembly.modes import AssemblyMode, AssemblyModes, SingularMode
from sixsps.assembly.solve import assembly_modes

__all__ = ["AssemblyMode", "AssemblyModes", "SingularMode", "assembly_modes"]
