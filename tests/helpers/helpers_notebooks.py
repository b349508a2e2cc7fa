"""Executes the tutorial notebook. By hand: ``python tests/helpers/helpers_notebooks.py``.

That writes its outputs anew. What differs from run to run is left out: bars of progress, what goes
to standard error, texts of what is shown as HTML anyway, sizes of files.
"""

import os
import re
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import nbformat
from nbclient import NotebookClient

ROOT = Path(__file__).parents[2]
NOTEBOOK = ROOT / "docs" / "tutorial.ipynb"
MEGABYTES = re.compile(r"[\d.]+ MB")
KERNEL = {"display_name": "Python 3", "language": "python", "name": "python3"}


def tutorial():
    """The notebook as it is in the repository."""
    return nbformat.read(NOTEBOOK, as_version=4)


def executed(notebook):
    """The notebook, with its new outputs, once all of its cells have been executed.

    The kernel is this interpreter; sockets, settings and what the cells write are in a directory
    that is removed. A name of few letters: those of sockets may be no longer than a hundred.
    """
    with tempfile.TemporaryDirectory(prefix="nb-") as folder, _environment(Path(folder)):
        work = Path(folder) / "work"
        work.mkdir()
        client = NotebookClient(
            notebook, kernel_name="python3", resources={"metadata": {"path": str(work)}}
        )
        manager = client.create_kernel_manager()
        manager.transport, manager.connection_file = "ipc", f"{folder}/kernel.json"
        client.execute()
        assert not (ROOT / "kernel-ipc-1").exists()
    return notebook


@contextmanager
def _environment(folder):
    before = dict(os.environ)
    paths = [str(ROOT), *filter(None, [before.get("PYTHONPATH")])]
    own = {"PYTHONPATH": os.pathsep.join(paths), "IPYTHONDIR": f"{folder}/ipython"}
    # The command is the one that is installed beside this interpreter.
    own["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), before.get("PATH", "")])
    own |= {f"JUPYTER_{name}_DIR": f"{folder}/{name}" for name in ("RUNTIME", "DATA", "CONFIG")}
    # Colours would stand in the outputs as codes.
    os.environ.update(own | {"NO_COLOR": "1"})
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def is_progress(output):
    """Whether an output is a bar."""
    return output.get("metadata", {}).get("encircle") == "progress"


def lasting_outputs(cell):
    """A cell's outputs, as far as they are the same each time."""
    kept = []
    for output in cell.get("outputs", []):
        if is_progress(output) or output.get("name") == "stderr":
            continue
        output = nbformat.from_dict(output)
        if output["output_type"] == "stream":
            output["text"] = MEGABYTES.sub("... MB", output["text"])
            if kept and kept[-1].get("name") == output["name"]:
                # How a stream is cut into pieces depends on how fast it came.
                kept[-1]["text"] += output["text"]
                continue
        elif "text/html" in output["data"]:
            output["data"].pop("text/plain", None)
        kept.append(output)
    return kept


def main():
    """Write the notebook with its outputs."""
    notebook = executed(tutorial())
    for cell in notebook.cells:
        cell["metadata"] = nbformat.from_dict({})
        if cell.cell_type == "code":
            cell["outputs"] = lasting_outputs(cell)
    about = {"kernelspec": KERNEL, "language_info": {"name": "python"}}
    notebook["metadata"] = nbformat.from_dict(about)
    nbformat.write(notebook, NOTEBOOK)


if __name__ == "__main__":
    main()
