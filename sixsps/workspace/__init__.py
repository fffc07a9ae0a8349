"""Workspaces: which positions and orientations can be reached, with bounds that are proven."""

from sixsps.workspace.result import EmptyWorkspaceError as EmptyWorkspaceError
from sixsps.workspace.result import Workspace as Workspace
from sixsps.workspace.result import WorkspaceCells as WorkspaceCells
from sixsps.workspace.search import constant_orientation_workspace as constant_orientation_workspace
from sixsps.workspace.search import orientation_workspace as orientation_workspace
