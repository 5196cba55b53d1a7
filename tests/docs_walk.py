"""The documentation as the tests see it: pages, fenced blocks, links."""

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
TRIED = (DOCS / "tutorial.md", DOCS / "tutorial_diagnosis.md", *sorted((DOCS / "howto").glob("*.md")))
"""Pages whose blocks are run in their order."""
_FENCE = re.compile(r"^```(?P<head>[^\n]*)\n(?P<text>.*?)^```\s*$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, the file it is to be saved as ('' for none), its text, its line in the page."""

    language: str
    title: str
    text: str
    line: int


def blocks(page: Path) -> list[Block]:
    """All fenced blocks of a page, in their order."""
    content = page.read_text(encoding="utf-8")
    found = []
    for match in _FENCE.finditer(content):
        head = match["head"].strip()
        title = re.search(r'title="([^"]+)"', head)
        language = head.split(" ")[0]
        line = content.count("\n", 0, match.start()) + 1
        found.append(Block(language, title[1] if title else "", match["text"], line))
    return found
