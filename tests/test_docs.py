"""Every Python block of the pages in docs/ runs, in order, and prints what the page says it prints.

The blocks of a page are one program. A block of `text` right after one of `python` is its output, letter for
letter; a page shows what does not change from machine to machine.
"""

import contextlib
import io
import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"
PAGES = sorted(DOCS.glob("*.md"))
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", flags=re.DOTALL | re.MULTILINE)
# Library -> what a page that imports it is skipped without.
OPTIONAL = ("pinocchio", "mujoco", "pydrake", "dartpy", "exudyn", "matplotlib", "example_robot_data")


def programs(page):
    """(line, code, expected output or None) of every Python block."""
    text = page.read_text(encoding="utf-8")
    blocks = list(BLOCK.finditer(text))
    for block, following in zip(blocks, [*blocks[1:], None][: len(blocks)], strict=True):
        if block[1] != "python":
            continue
        shown = (
            following is not None
            and following[1] == "text"
            and not text[block.end() : following.start()].strip()
        )
        yield text.count("\n", 0, block.start(2)), block[2], following[2] if shown else None


@pytest.mark.parametrize("page", [page for page in PAGES if list(programs(page))], ids=lambda page: page.stem)
def test_page_runs_and_prints_what_it_shows(page, tmp_path, monkeypatch):
    for library in OPTIONAL:
        if re.search(rf"^\s*(import|from) {library}\b", page.read_text(encoding="utf-8"), flags=re.MULTILINE):
            pytest.importorskip(library)
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "__main__"}
    for line, code, expected in programs(page):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            # As many lines before it as on the page, so that a traceback tells its line.
            exec(compile("\n" * line + code, str(page), "exec"), names)
        shown = "" if expected is None else expected
        assert printed.getvalue() == shown, f"{page.name}, the block at line {line + 1}"


def test_links_to_files_lead_somewhere():
    for page in PAGES:
        for target in re.findall(r"\]\((?!https?:|#)([^)#]+)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_there_are_programs():
    assert sum(1 for page in PAGES for _ in programs(page)) >= 7
