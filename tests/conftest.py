"""Shared fixtures."""

import pytest
from cases import BUNDLED, RECORDED
from hypothesis import settings

from sixsps.mechanism import Mechanism
from sixsps.motion import Motion

# A shared machine stalls now and then; a slow example is no failing law.
settings.register_profile("project", deadline=None, derandomize=True)
settings.load_profile("project")


@pytest.fixture(params=BUNDLED)
def mechanism(request):
    """Each bundled mechanism."""
    return Mechanism.load(request.param)


@pytest.fixture(scope="session")
def wu2012():
    return Mechanism.load("wu2012")


@pytest.fixture(scope="session")
def recorded():
    """The recorded motion, derivatives estimated, as it stands in its file."""
    if not RECORDED.exists():
        pytest.skip("the recorded motion lies beside the checkout, not in it, and is not here")
    return Motion.load(RECORDED)
