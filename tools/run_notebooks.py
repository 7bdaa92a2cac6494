"""Runs notebooks of examples/notebooks from their first cell to their last, and keeps what they print and draw.

Usage: .venv/bin/python tools/run_notebooks.py [--check] [NOTEBOOK...]      (default: all; needs tools/setup_venv.sh)

Times, progress and folders of runs are left out, so that another run of the same package changes little. With --check the files
stay unchanged; the script only checks that all cells run.
An output above 200 kB is an error, because files with such outputs are
too large for a repository: draw less, or print less.
"""

import argparse
import os
import re
import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "examples" / "notebooks"
MAX_OUTPUT = 200_000


def run(file: Path, seconds: int) -> nbformat.NotebookNode:
    """A notebook with the outputs of its cells."""
    notebook = nbformat.read(file, as_version=4)
    # It runs in its own folder, as in Jupyter.
    NotebookClient(notebook, timeout=seconds, kernel_name="python3", resources={"metadata": {"path": str(file.parent)}}).execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        if cell.cell_type == "code":
            cell.outputs = [kept(output) for output in cell.outputs if output.get("name") != "stderr"]
    notebook.metadata.pop("widgets", None)
    notebook.metadata["language_info"] = {"name": "python"}
    return notebook


def kept(output: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """An output without what differs from machine to machine."""
    if "text" in output:
        output.text = re.sub(r"(/[\w.+-]+)+/(runs|shared)/", r"…/\2/", output.text)
    data = output.get("data", {})
    if "image/png" in data:
        # The picture alone; its description says nothing.
        data.pop("text/plain", None)
    size = len(nbformat.writes(nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(outputs=[output])])))
    if size > MAX_OUTPUT:
        sys.exit(f"run_notebooks.py: an output has {size} bytes, more than {MAX_OUTPUT}")
    return output


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("notebooks", nargs="*", type=Path)
    parser.add_argument("--check", action="store_true", help="write nothing")
    parser.add_argument("--seconds", type=int, default=3600, help="longest time of a cell")
    options = parser.parse_args()
    # The package of this checkout, if it was built there (tools/test_python.sh).
    os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT / "python"), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    for file in options.notebooks or sorted(FOLDER.glob("*.ipynb")):
        notebook = run(file, options.seconds)
        if not options.check:
            nbformat.write(notebook, file)
        print(f"{file.name}: {len(notebook.cells)} cells, {len(nbformat.writes(notebook)) // 1000} kB")


if __name__ == "__main__":
    main()
