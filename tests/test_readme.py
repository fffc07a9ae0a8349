"""Every snippet of the README runs, and prints what the README says."""

import contextlib
import io
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

README = Path(__file__).parents[1] / "README.md"
BLOCKS = re.findall(r"```(\w*)\n(.*?)```", README.read_text(), flags=re.DOTALL)
PYTHON = [
    (code, BLOCKS[index + 1][1]) for index, (language, code) in enumerate(BLOCKS) if language == "python"
]
COMMANDS = [
    line.removeprefix("$ ")
    for language, text in BLOCKS
    if language == "console"
    for line in text.splitlines()
]


@pytest.mark.parametrize(("code", "output"), PYTHON)
def test_python_snippet_prints_what_is_shown(code, output):
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, str(README), "exec"), {})
    assert printed.getvalue() == output


@pytest.mark.parametrize("command", COMMANDS)
def test_command_runs(command, tmp_path):
    program, *arguments = shlex.split(command)
    assert program == "sixsps"
    done = subprocess.run(
        [sys.executable, "-m", "compare", *arguments], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_there_are_snippets_to_run():
    assert len(PYTHON) >= 2
    assert len(COMMANDS) >= 7


def test_picture_and_make_targets_exist():
    text = README.read_text()
    for path in re.findall(r"\]\(([^)h][^)]*)\)", text):
        assert (README.parent / path).exists(), path
    makefile = (README.parent / "Makefile").read_text()
    for target in re.findall(r"^make (\w+)", text, flags=re.MULTILINE):
        assert f"\n{target}:" in makefile
