"""Names of the rows, by which measurements and report find each other."""

FAST, VECTORISED, KANE, PINOCCHIO, RNEA = "fast", "numpy", "kane", "pinocchio", "pinocchio rnea"
MAPPED, ONE_BY_ONE = "casadi, mapped", "casadi, one by one"
PEAK, TRIAD = "peak", "triad"
FORCES, EXACT, DIFFERENCES, CASADI = "forces", "exact", "differences", "casadi"
BARE, IMPORT, HELP = "python", "import sixsps", "sixsps --help"
FORCES_REUSED, EXACT_REUSED = "forces, arrays reused", "exact, arrays reused"
CACHE, MEMORY = "cache", "memory"


def on_threads(name: str, count: int) -> str:
    """Returns the name of something on so many threads."""
    return f"{name}, {count} thread{'s' if count > 1 else ''}"
