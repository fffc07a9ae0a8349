"""Programs run on a terminal, as people run them."""

import os
import pty
import subprocess


def on_terminal(command, **options):
    """What a command writes to its standard output, and what it shows on its standard error, a terminal."""
    main, other = pty.openpty()
    environment = os.environ | {"TERM": "xterm-256color", "COLUMNS": "80"}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=other, env=environment, **options
    ) as process:
        os.close(other)
        shown = b""
        while True:
            try:
                piece = os.read(main, 4096)
            except OSError:
                break
            shown += piece
            if not piece:
                break
        written = process.stdout.read()
    os.close(main)
    assert process.returncode == 0
    return written, shown
