"""Benchmarks: `make bench`, or `python -m benchmarks`; no part of the wheel.

What is compared is timed turn by turn, A B C A B C, and every ratio is taken within a round, so that what
disturbs the machine disturbs both sides. pytest-benchmark times one function to the end before it starts
the next and has no place for ratios, percentiles of single calls or a share of the machine's peak; hence
the harness of its own, `rounds.py`.

`python -m benchmarks` measures and writes `results.json`, raw times by round; `report.py` makes everything
else of that file: medians, spreads, ratios, Markdown.
"""
