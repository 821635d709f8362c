"""Tests of the Markdown pages: every relative link leads somewhere, and the list of files is the files'."""

import re
import unittest

from docs import file_list

ROOT = file_list.ROOT
LINK = re.compile(r"\]\(([^)\s]+)\)")


def pages():
    found = [path for path in ROOT.rglob("*.md") if "target" not in path.parts]
    return [path for path in found if not any(part.startswith(".") for part in path.relative_to(ROOT).parts)]


def anchors(page):
    """The anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    words = (re.sub(r"\]\([^)]*\)", "", heading).lower() for heading in headings)
    return {re.sub(r"[^\w\- ]", "", heading).strip().replace(" ", "-") for heading in words}


def broken(page):
    """The links of a page that lead nowhere; web addresses are not followed."""
    text = re.sub(r"^```.*?^```|^    .*?$|`[^`\n]*`", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    for target in LINK.findall(text):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        path = (page.parent / name).resolve() if name else page
        if not path.exists() or (anchor and path.suffix == ".md" and anchor not in anchors(path)):
            yield f"{page.relative_to(ROOT)}: {target}"


class Pages(unittest.TestCase):
    def test_links_lead_somewhere(self):
        self.assertGreater(len(pages()), 10)
        self.assertEqual([link for page in pages() for link in broken(page)], [])

    def test_a_broken_link_is_found(self):
        text = (
            "[a](no-such-file.md) [b](../README.md) [c](../README.md#no-such-heading) [d](https://example.org) `[e](x)`"
        )
        page = ROOT / "docs" / ".test_docs.md"
        try:
            page.write_text(text)
            found = [link.split(": ")[1] for link in broken(page)]
        finally:
            page.unlink()
        self.assertEqual(found, ["no-such-file.md", "../README.md#no-such-heading"])

    def test_the_list_of_files_is_current(self):
        page = file_list.PAGE.read_text()
        self.assertTrue(file_list.updated(page) == page, "run `python3 docs/file_list.py`")


if __name__ == "__main__":
    unittest.main()
