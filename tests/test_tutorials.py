"""The tutorials run at a small size, and their pages show pictures that they make."""

import os
import re
import subprocess
import sys

import pytest

from conftest import ROOT

PAGES = ROOT / "docs/tutorials"
SCRIPTS = sorted(path.name for path in PAGES.glob("*.py"))
SAYS = {  # what a script prints at the small size
    "budding_vesicle.py": r"hang on a boundary of \d\.\d\d nm",
    "domains.py": r"step   30: .* domains, the largest has \d+%",
    "first_vesicle.py": r"prolate|oblate|sphere",
    "fluctuations.py": r"kappa = [\d.]+ \+- [\d.]+ kT",
    "minimize_and_anneal.py": r"oblate_minimized: oblate, v = 0.80.*sphere_minimized: prolate, v = 0.80",
    "phase_diagram.py": r"prolate to 0.75: prolate, E/8πκ = 1\.4",
    "sheet.py": r"tension 0: kappa = [\d.]+ \+- [\d.]+ kT.*tension 1: kappa = [\d.]+ \+- [\d.]+ kT",
    "tether.py": r"pole at 1\.2\d nm: 0\.[1-4]\d f0",
}
SMALL = {"HELFRICH_TUTORIAL_SIZE": "small", "OPENBLAS_NUM_THREADS": "1", "PYTHONUTF8": "1"}


@pytest.mark.parametrize("name", SCRIPTS)
def testTutorial(tmp_path, name):
    environment = os.environ | SMALL | {"MPLBACKEND": "Agg"}
    done = subprocess.run([sys.executable, PAGES / name], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert re.search(SAYS[name], done.stdout, re.DOTALL), done.stdout
    pictures = re.findall(r"!\[[^]]+\]\((\S+\.png)\)", (PAGES / name).read_text(encoding="utf-8"))
    assert pictures
    for picture in pictures:
        assert (PAGES / picture).stat().st_size > 10000 and (tmp_path / picture).stat().st_size > 5000


def testNotebook(tmp_path, monkeypatch):
    """The notebook runs without a browser; its slider deflates the vesicle, and the widgets show that."""
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipywidgets")
    for name, value in SMALL.items():
        monkeypatch.setenv(name, value)
    notebook = nbformat.read(PAGES / "deflating_vesicle.ipynb", as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells)
    client = nbclient.NotebookClient(notebook, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}})
    client.execute()
    values = [state.get("value") for state in client.widget_state.values()]
    assert any(re.match(r"v = 0\.(89|90|91), bending energy 1\.\d\d times", str(value)) for value in values)
    assert 0.9 in values
    kinds = [list(output.get("data", ())) for cell in notebook.cells for output in cell.get("outputs", ())]
    assert any("application/vnd.jupyter.widget-view+json" in kind for kind in kinds) and "image/png" in kinds[-1]


@pytest.mark.parametrize("name", SCRIPTS)
def testCells(name):
    """A tutorial begins with a heading, has prose before and after all code, and every line is in a cell."""
    kinds = re.findall(r"^# %%(.*)$", (PAGES / name).read_text(encoding="utf-8"), re.MULTILINE)
    assert (PAGES / name).read_text(encoding="utf-8").startswith("# %% [markdown]\n# # ")
    assert kinds[-1].strip() == "[markdown]" and set(map(str.strip, kinds)) == {"", "[markdown]"}
