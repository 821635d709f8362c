"""Writes the list of files in ARCHITECTURE.md: of every file the first sentence of its own documentation.

python3 docs/file_list.py
"""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "ARCHITECTURE.md"
FOLDERS = ["image", "kernels", "frames", "metrics", "shots", "core", "onnx", "oidn", "cli", "arrays", "page"]
FOLDERS += ["train", "infer", "python", "capi", "testkit", "tests", "fuzz", "reference-py", "bench", "scenes"]
FOLDERS += ["integrations", "docs"]
START, END = "<!-- files: written by docs/file_list.py -->\n", "<!-- end of files -->\n"


def updated(page):
    """The page with its list of files as it should be."""
    head, rest = page.split(START)
    _, tail = rest.split(END)
    tables = [table(folder) for folder in FOLDERS if sources(ROOT / folder)]
    return head + START + "\n".join(tables) + "\n\n" + END + tail


def table(folder):
    """A heading and a table of the files of one folder."""
    rows = [f"| {link(path)} | {first_sentence(path)} |" for path in sources(ROOT / folder)]
    return "\n".join([f"\n### {folder}/\n", "| file | what |", "|---|---|", *rows])


def link(path):
    inside = path.relative_to(ROOT)
    return f"[{inside.relative_to(inside.parts[0])}](../{inside})"


def sources(folder):
    """Rust and Python files with documentation of their own, sorted; build products are left out."""
    found = sorted(path for path in folder.rglob("*") if path.suffix in (".rs", ".py") and "target" not in path.parts)
    return [path for path in found if first_sentence(path)]


def first_sentence(path):
    """First sentence of the documentation of a file, on one line; empty where it has none."""
    text = path.read_text()
    if path.suffix == ".py":
        words = ast.get_docstring(ast.parse(text)) or ""
    else:
        words = "\n".join(re.findall(r"^//! ?(.*)$", text, re.MULTILINE))
    paragraph = " ".join(words.split("\n\n")[0].split())
    sentence = re.match(r"(.*?(?<!Eq)(?<!Eqs)(?<!Sect)(?<!al)\.) ", paragraph + " ")
    plain = re.sub(r"\[(`[^`]*`)\](?!\()", r"\1", sentence[1] if sentence else paragraph)
    return plain.rstrip(".:").replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(updated(PAGE.read_text()))
