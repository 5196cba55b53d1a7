"""The notebooks of docs/notebooks: each script in cells becomes a notebook that was executed, with its pictures.

python docs/make_notebooks.py [NAME ...]
"""

import re
import sys
from pathlib import Path

FOLDER = Path(__file__).parent / "notebooks"
_MARK = re.compile(r"^# %%(?P<kind> \[markdown\])?\n", re.MULTILINE)


def cells_of(text: str) -> list[tuple[str, str]]:
    """("markdown" or "code", its text) of each cell of a script."""
    marks = [*_MARK.finditer(text)]
    ends = [mark.start() for mark in marks[1:]] + [len(text)]
    cells = []
    for mark, end in zip(marks, ends, strict=True):
        body = text[mark.end() : end].strip()
        if mark["kind"]:
            cells.append(("markdown", re.sub(r"^# ?", "", body, flags=re.MULTILINE)))
        else:
            cells.append(("code", body))
    return cells


def make(script: Path) -> None:
    """Executes a script's cells and writes the notebook beside it."""
    import nbclient
    import nbformat.v4 as form

    new = {"markdown": form.new_markdown_cell, "code": form.new_code_cell}
    cells = [new[kind](text, id=f"cell-{n}") for n, (kind, text) in enumerate(cells_of(script.read_text("utf-8")))]
    notebook = form.new_notebook(cells=cells)
    nbclient.NotebookClient(notebook, timeout=600, kernel_name="python3").execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)  # when it ran
    notebook.metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    import nbformat

    nbformat.write(notebook, script.with_suffix(".ipynb"))


if __name__ == "__main__":
    named = sys.argv[1:] or [script.stem for script in sorted(FOLDER.glob("*.py"))]
    for name in named:
        make(FOLDER / f"{name}.py")
        print(f"{name}.ipynb")
