"""The second tier of tests: what takes longer than README's test command may, run by `python -m pytest -n auto -m slow`.

A test or a parameter with the mark `slow` is in it. Of a test with the mark `few`, four parameters that differ as much as possible
are in the first tier; `few(n)` means n of them.
"""

import re

import pytest


def slow(*values, **options):
    """Return one parameter, or one row of parameters, marked as slow."""
    return pytest.param(*values, marks=pytest.mark.slow, **options)


def mark_all_but_few(items):
    """Mark items of tests with the mark `few` as slow, except the few that differ most."""
    groups = {}
    for item in items:
        if mark := item.get_closest_marker("few"):
            groups.setdefault((item.path, item.originalname, *(mark.args or (4,))), []).append(item)
    for (_, _, count), group in groups.items():
        few = differing([frozenset(re.split("[-, ]+", item.callspec.id)) for item in group], count)
        for number, item in enumerate(group):
            if number not in few:
                item.add_marker(pytest.mark.slow)


def differing(words, count):
    """Return the numbers of `count` sets of words: each next one adds the most new words, and equal ones are spread evenly."""
    spread = sorted(range(len(words)), key=lambda number: number * 0.618034 % 1)
    chosen, seen = [], frozenset()
    while spread and len(chosen) < count:
        chosen.append(max(spread, key=lambda number: len(words[number] - seen)))
        spread.remove(chosen[-1])
        seen |= words[chosen[-1]]
    return chosen
