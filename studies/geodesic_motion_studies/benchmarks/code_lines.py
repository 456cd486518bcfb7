"""Lines of code of Python files: those that are neither blank nor comments nor docstrings.

    python -m geodesic_motion_studies.benchmarks.code_lines FILE_OR_FOLDER ...
"""

from __future__ import annotations

import ast
import io
import sys
import tokenize
from pathlib import Path

_EMPTY = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER,
}  # fmt: skip


def code_lines(source: str) -> int:
    """How many lines of a module are code."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in _EMPTY:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(source)):
        documented = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        if documented and ast.get_docstring(node, clean=False) is not None:
            docstring = node.body[0]
            lines.difference_update(range(docstring.lineno, docstring.end_lineno + 1))
    return len(lines)


def main() -> None:
    """Print the lines of every file, and their sum."""
    files = [file for path in map(Path, sys.argv[1:]) for file in (sorted(path.rglob("*.py")) or [path])]
    counts = {file: code_lines(file.read_text(encoding="utf-8")) for file in files}
    for file, count in counts.items():
        print(f"{count:6d} {file}")
    print(f"{sum(counts.values()):6d} in all")


if __name__ == "__main__":
    main()
