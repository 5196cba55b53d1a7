"""Text between the marks `<!-- name -->` and `<!-- end of name -->` of a document, which the benchmarks write anew."""


def put(text: str, name: str, content: str) -> str:
    """The text with new content between the marks of a name."""
    start, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
    before, rest = text.split(start)
    return before + start + content + "\n" + end + rest.split(end, 1)[1]
