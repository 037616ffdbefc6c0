#!/usr/bin/env python3
"""Counts of the tracked Rust and WGSL sources: lines by kind, and lengths of functions.

Lines of `#[cfg(test)]` modules, of files named `tests.rs` or `*_tests.rs` and of the folders `tests`, `examples` and
`fuzz` count as tests. Strings and comments are blanked before braces are counted.

    python3 tests/count_lines.py [--repo DIR] [--markdown]
"""

import argparse
import re
import statistics
import subprocess
from pathlib import Path

PRODUCT = ["tracer/src", "protocol/src", "farm/src", "game/src", "game/billiards/src"]
MEASURING = ["tests/bench", "tests/testkit"]
BLANKED = re.compile(
    r'//[^\n]*|/\*.*?\*/|b?r(#*)".*?"\1|b?"(?:\\.|[^"\\])*"|b?\'(?:\\.[^\']*|[^\'\\])\'', re.S
)
FUNCTION = re.compile(r"\bfn\s+\w+")


def blank(text):
    """The text with comments and strings replaced by spaces, line breaks kept."""
    return BLANKED.sub(lambda found: re.sub(r"[^\n]", " ", found.group()), text)


def end_of_block(code, start):
    """The position behind the brace that closes the first block after `start`, or None for a declaration."""
    depth = 0
    for position in range(start, len(code)):
        if code[position] == "{":
            depth += 1
        elif code[position] == "}":
            depth -= 1
            if depth == 0:
                return position + 1
        elif code[position] == ";" and depth == 0:
            return None
    return len(code)


def test_lines(code):
    """Numbers of the lines inside items marked `#[cfg(test)]`."""
    lines = set()
    for found in re.finditer(r"#\[cfg\(test\)\]", code):
        end = end_of_block(code, found.end())
        if end is not None:
            first = code.count("\n", 0, found.start())
            lines.update(range(first, code.count("\n", 0, end) + 1))
    return lines


def is_test_file(path):
    parts = Path(path).parts
    if any(part in ("examples", "fuzz") for part in parts):
        return True
    if "tests" in parts and not any(path.startswith(folder) for folder in MEASURING):
        return True
    if "tests" in parts[2:-1]:
        return True
    return parts[-1] == "tests.rs" or parts[-1].endswith("_tests.rs")


def count(path, text):
    """Lines by kind and the lengths of the functions outside tests."""
    code = blank(text)
    inside = test_lines(code) if path.endswith(".rs") else set()
    kinds = dict(files=1, lines=0, code=0, tests=0, doc=0, comment=0, blank=0)
    whole_test = is_test_file(path)
    for number, line in enumerate(text.splitlines()):
        line = line.strip()
        kinds["lines"] += 1
        if whole_test or number in inside:
            kinds["tests"] += 1
        elif not line:
            kinds["blank"] += 1
        elif line.startswith(("///", "//!")):
            kinds["doc"] += 1
        elif line.startswith("//"):
            kinds["comment"] += 1
        else:
            kinds["code"] += 1
    lengths = []
    for found in FUNCTION.finditer(code):
        first = code.count("\n", 0, found.start())
        end = end_of_block(code, found.end())
        if end is not None and first not in inside and not whole_test:
            lengths.append(code.count("\n", 0, end) - first + 1)
    return kinds, lengths


def room(path):
    for folder in sorted(PRODUCT + MEASURING, key=len, reverse=True):
        if path.startswith(folder + "/"):
            return folder
    return "tests, examples, fuzz"


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--repo", default=Path(__file__).parent.parent, type=Path)
    options = arguments.parse_args()
    listed = subprocess.run(
        ["git", "-C", options.repo, "ls-files", "*.rs", "*.wgsl"], check=True, capture_output=True, text=True
    ).stdout.split()
    rooms, lengths = {}, {}
    for path in listed:
        kinds, functions = count(path, (options.repo / path).read_text())
        for name in (room(path), "all", *(["all product code"] if room(path) in PRODUCT else [])):
            total = rooms.setdefault(name, dict.fromkeys(kinds, 0))
            for kind, lines in kinds.items():
                total[kind] += lines
            lengths.setdefault(name, []).extend(functions)
    columns = ["files", "lines", "code", "tests", "doc", "comment", "blank"]
    print("| where | " + " | ".join(columns) + " | functions | median | 95th | longest | > 40 | > 70 |")
    print("|---" * (len(columns) + 7) + "|")
    last = ["tests, examples, fuzz", "all product code", "all"]
    for name in [n for n in PRODUCT + MEASURING if n in rooms] + last:
        functions = sorted(lengths[name]) or [0]
        cells = [f"{rooms[name][column]:,}" for column in columns] + [
            f"{len(functions):,}",
            f"{statistics.median(functions):.0f}",
            functions[int(0.95 * (len(functions) - 1))],
            functions[-1],
            sum(length > 40 for length in functions),
            sum(length > 70 for length in functions),
        ]
        print(f"| {name} | " + " | ".join(map(str, cells)) + " |")


if __name__ == "__main__":
    main()
