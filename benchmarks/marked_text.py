"""Text between the marks `<!-- name -->` and `<!-- end of name -->` of a document, which the benchmarks write anew."""

from collections.abc import Mapping
from pathlib import Path

from msl_fem.files.whole_file import whole_file


def put(text: str, name: str, content: str) -> str:
    """The text with new content between the marks of a name."""
    start, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
    before, rest = text.split(start)
    return before + start + content.rstrip("\n") + "\n" + end + rest.split(end, 1)[1]


def rewrite(document: Path, contents: Mapping[str, str]) -> None:
    """Puts each content between the marks of its name in a document."""
    text = document.read_text(encoding="utf-8")
    for name, content in contents.items():
        text = put(text, name, content)
    with whole_file(document) as partial:
        partial.write_text(text, encoding="utf-8")
