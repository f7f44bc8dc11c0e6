"""Make the notebooks of examples/ from its scripts, without outputs.

python -m scripts.notebooks
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from auv_gym.writing import replacing

EXAMPLES = Path(__file__).parents[1] / "examples"


def notebook_of(script: Path) -> str:
    """The script as a notebook, identical for the same script."""
    import jupytext

    book = jupytext.reads(script.read_text(), fmt="py:percent")
    cells = []
    for number, cell in enumerate(book.cells):
        kept = {
            "cell_type": cell.cell_type,
            "id": f"cell-{number}",
            "metadata": {},
            "source": cell.source.splitlines(True),
        }
        cells.append(kept | ({"execution_count": None, "outputs": []} if cell.cell_type == "code" else {}))
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    content = {"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def main() -> int:
    """Write a notebook beside each script of examples/."""
    for script in sorted(EXAMPLES.glob("*.py")):
        path = script.with_suffix(".ipynb")
        with replacing(path) as new:
            Path(new).write_text(notebook_of(script))
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
