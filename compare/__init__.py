"""The application: engines, comparison, report, and the command `sixsps`."""
