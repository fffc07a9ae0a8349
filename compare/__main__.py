"""`python -m compare` is the command `sixsps`."""

from compare.cli import main

main()
