"""The site: prose that is plain, links that lead somewhere, names that are all there, and code that runs.

.ci/docs builds it, with warnings as errors.
"""

import contextlib
import inspect
import io
import json
import re
import shlex
import sys
import textwrap
from pathlib import Path

import numpy as np
import openmm as mm
import pytest
import typer
from openmm import app, unit

import openmmhelfrich as mh
from conftest import ROOT
from openmmhelfrich.cli.commands import app as commands
from openmmhelfrich.pictures.rendering import canRender
from openmmhelfrich.runs.config import parseConfig, sections, tomllib
from openmmhelfrich.runs.configfile import configText
from openmmhelfrich.runs.grids import readGrid

sys.path.insert(0, str(ROOT / "docs/_ext"))
from cells import cellsOfNotebook, cellsOfScript, pageOfCells

MOST_WORDS, MOST_WORDS_OF_A_PAGE = 40, 2500
DOCS = sorted((ROOT / "docs").rglob("*.md"))
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "ARCHITECTURE.md", *DOCS]
TUTORIALS = sorted([*(ROOT / "docs/tutorials").glob("*.py"), *(ROOT / "docs/tutorials").glob("*.ipynb")])
FENCE = re.compile(r"^( *)```(\{?[\w-]*\}?)[^\n]*\n(.*?)^\1```", re.MULTILINE | re.DOTALL)


def nameOf(page):
    return str(page.relative_to(ROOT))


def textOf(page):
    """Return the Markdown of a page, a script in cells or a notebook."""
    text = page.read_text(encoding="utf-8")
    if page.suffix == ".md":
        return text
    cells = cellsOfScript(text) if page.suffix == ".py" else cellsOfNotebook(text)
    return "\n\n".join(text for kind, text in cells if kind == "markdown")


def sentences(text):
    """Yield the sentences of a page: of its paragraphs, items of lists and cells of tables, but not of its code."""
    prose = re.sub(r"<!--.*?-->", "", FENCE.sub("\n\n", text), flags=re.DOTALL)
    for part in re.split(r"\n\s*\n|\n(?=\s*(?:[-*]|\d+\.|:|#+|\|) ?)", prose):
        for piece in part.split("|") if part.strip().startswith("|") else [part]:
            plain = re.sub(r"`[^`]*`", "code", re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", piece))
            yield from re.split(r"(?<=[.!?])[*_)\"']*\s+", " ".join(plain.split()))


@pytest.mark.parametrize("page", [*PAGES, *TUTORIALS], ids=nameOf)
def testSentencesAreShort(page):
    long = [sentence for sentence in sentences(textOf(page)) if len(sentence.split()) > MOST_WORDS]
    assert not long, f"{len(long)} sentences have more than {MOST_WORDS} words:\n" + "\n".join(long)


def testWhatASentenceIs():
    text = "# A head\n\nOne two. Three `a. b` four!\nFive\n\n- six (seven).\n| a | b. C |\n```bash\nx. y\n```\n"
    assert [s for s in sentences(text) if s] == [
        "# A head", "One two.", "Three code four!", "Five", "- six (seven).", "a", "b.", "C"
    ]  # fmt: skip


def testWhatACellIs():
    script = '"""Head."""\n# %% [markdown]\n# # Title\n#\n# Prose.\n# %%\nx = 1\n'
    cells = [
        {"cell_type": "markdown", "source": ["# Title\n", "\n", "Prose."]},
        {"cell_type": "code", "source": "x = 1"},
    ]
    assert cellsOfScript(script) == cellsOfNotebook(json.dumps({"cells": cells}))
    assert pageOfCells(cellsOfScript(script)) == "# Title\n\nProse.\n\n```python\nx = 1\n```\n"


@pytest.mark.parametrize("page", [page for page in PAGES if "results" not in page.parts], ids=nameOf)
def testPagesAreShort(page):
    assert len(page.read_text(encoding="utf-8").split()) <= MOST_WORDS_OF_A_PAGE


def testTheReadmeFitsOnAFewScreens():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 120


def anchorsOf(page):
    heads = re.findall(r"^#+ (.*)$", FENCE.sub("", page.read_text(encoding="utf-8")), re.MULTILINE)
    return {
        re.sub(r"[^\w\- ]", "", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", head).lower()).replace(" ", "-")
        for head in heads
    }


@pytest.mark.parametrize("page", PAGES, ids=nameOf)
def testLinksLeadSomewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", FENCE.sub("", page.read_text(encoding="utf-8"))):
        if re.match(r"\w+:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path) if path else page
        assert file.exists(), f"{target} is not there"
        assert not anchor or anchor in anchorsOf(file), f"{target}: {file.name} has no such heading"


@pytest.mark.parametrize("page", TUTORIALS, ids=nameOf)
def testPicturesOfTutorialsAreThere(page):
    for picture in re.findall(r"!\[[^\]]*\]\(([^)\s]+)\)", textOf(page)):
        assert (page.parent / picture).exists()


def testEveryNameIsOnAPage():
    pages = "\n".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs/reference").glob("*.md"))
    described = set(re.findall(r"auto(?:class|function|exception):: openmmhelfrich\.(\w+)$", pages, re.MULTILINE))
    assert described == set(mh.__all__)


def testEveryKeyAndOptionIsDescribed():
    pytest.importorskip("sphinx")
    import generated

    keys, texts = generated.configuration(), generated.commandTexts()
    for name, section in sections().items():
        for key, field in section.model_fields.items():
            assert f"{{confval}} {name}.{key}\n" in keys and field.description
    for name, command in generated.commandsIn(typer.main.get_command(commands)):
        assert f"## {name}\n" in texts and command.help
        for parameter in command.params:
            assert parameter.help and (parameter.metavar or parameter.opts[0]) in texts


# Code.  Each page is run from top to bottom, in a folder of its own that has what pages speak of: a mesh, small
# configurations, a simulation.  What is done elsewhere, or takes too long, is checked to be there.

EXTRAS = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"])
# Pages whose code another test runs, which knows what should come of it.
ELSEWHERE = {
    "docs/how-to/free-energies.md": "test_examples.py",
    "docs/how-to/from-freedts.md": "test_guides.py",
    "docs/how-to/from-mosaic.md": "test_guides.py",
    "docs/how-to/from-trimem.md": "test_guides.py",
    "docs/results/speed-accuracy.md": "test_tradeoff.py",
}
LONG = ("sweep", "minima", "tradeoff")  # commands whose arguments are read, and no more
# What other programs do is not tested here, but for scripts that must be there, and extras.
OTHERS = ("python3", "cmake", "ctest", "pytest", "dask", "doxygen", "export", "for", "done", "source", "git", "ruff")


def configurations(folder):
    """Write the files that pages speak of."""
    mesh = mh.Mesh.icosphere(2, 20)
    for name in ("cell.stl", "cell.ply", "sphere.obj", "raw.ply"):
        mesh.write(folder / name)
    mh.Mesh.merged(
        [mh.Mesh.icosphere(2), mh.Mesh(mh.Mesh.icosphere(2).vertices + 5, mh.Mesh.icosphere(2).triangles)]
    ).write(folder / "two.stl")
    stages = [{"kind": "sample", "steps": 10}, {"name": "cool", "kind": "anneal", "steps": 10, "end_temperature": 100}]
    vesicle = {"mesh": {"icosphere": 2}, "output": {"overwrite": True}, "stages": stages}
    (folder / "results").mkdir()
    for name in ("vesicle.toml", "scene.toml", "results/cell.toml"):
        (folder / name).write_text(configText(vesicle))
    (folder / "grid.toml").write_text('base = "vesicle.toml"\n[grid]\nmembrane.reduced_volume = [0.99, 1.0]\n')
    mh.writeMeshTrajectory(folder / "vesicle.vtkhdf", [mh.meshFrame(0, mesh)])
    (folder / "examples").mkdir()
    for file in (ROOT / "examples").iterdir():
        (folder / "examples" / file.name).write_bytes(file.read_bytes())
    for name in ("stomatocyte", "hysteresis"):
        data = tomllib.loads((folder / f"examples/{name}.toml").read_text())
        data["mesh"] = {"icosphere": 2}
        for stage in data["stages"]:
            stage.update({key: 2 for key in ("steps", "windows", "equilibration") if key in stage})
        (folder / f"examples/{name}.toml").write_text(configText(data))


def scene():
    """Return the names that pages take for granted."""
    mesh = mh.Mesh.icosphere(2)
    made = mh.Scene.of({"sampling": {"seed": 1}}, mesh)
    force = made.createForce()
    simulation = made.createSimulation(force)
    names = {"mesh": mesh, "force": force, "simulation": simulation, "integrator": simulation.integrator}
    names |= {"temperature": 300 * unit.kelvin, "kT": made.kT * unit.kilojoule_per_mole, "R": 1.0}
    names |= {"ring": mesh.edges[:3], "context": simulation.context, "system": simulation.system}
    return names | {"np": np, "mm": mm, "app": app, "unit": unit, "mh": mh, "__name__": "page"}


@pytest.fixture
def quick(monkeypatch, inFolder):
    """A folder for code, whose runs draw no pictures: that takes longer than all else, and other tests do it."""
    for name in ("plotObservables", "drawMesh", "plotPath"):
        monkeypatch.setattr(f"openmmhelfrich.runs.studies.{name}", lambda data, file, *rest: Path(file).touch())
    monkeypatch.setenv("PYVISTA_OFF_SCREEN", "true")
    configurations(inFolder)
    return inFolder


def blocksOf(page):
    """Return the language and the text of each block of code."""
    return [(language, textwrap.dedent(text)) for _, language, text in FENCE.findall(page.read_text(encoding="utf-8"))]


def runCommand(line):
    """Run a command of the package as the shell would, or read its arguments if it takes long."""
    line, _, printed = line.partition(" > ")
    words = [word for word in shlex.split(line, comments=True) if not re.match(r"[A-Z_]+=", word)]
    if not words or words[0] in OTHERS:
        return
    if words[0] == "pip":
        extras = {extra for word in words for names in re.findall(r"\[([\w,]+)\]", word) for extra in names.split(",")}
        assert extras <= EXTRAS, line
    elif words[0] == "python" or "/" in words[0]:
        script = words[1] if words[0] == "python" else words[0]
        assert (ROOT / script).exists() or script.startswith(("-", "build")), line
    else:
        runOwn(line, words, printed.split("#")[0].strip())


def runOwn(line, words, printed):
    """Run a command of the package, with what it prints in a file if there is none of this name."""
    assert words[0] == "openmm-helfrich", line
    group, (name, *arguments) = typer.main.get_command(commands), words[1:]
    if name in LONG:
        group.commands[name].make_context(name, arguments)
        return
    if name == "run" and "--steps" not in arguments and "stages" not in Path(arguments[0]).read_text():
        arguments += ["--steps", "20"]
    if name == "run":
        arguments.append("--overwrite")
    with contextlib.redirect_stdout(io.StringIO()) as out:
        code = group.main([name, *arguments], standalone_mode=False) or 0
    assert code in ((0, 1) if name == "check" else (0, 3)), f"{line}: exit code {code}"
    if printed and not Path(printed).exists():
        Path(printed).write_text(out.getvalue())
    for word in words[2:]:
        isFile = re.fullmatch(r"results/[\w/]+\.(?!pvd|ply)\w+", word)
        assert not isFile or Path(word).exists(), f"{line}: {word} has not been written"


def readConfiguration(text, folder):
    """Read a configuration, or a grid, as it stands, beside a mesh where it has none."""
    data = tomllib.loads(text)
    if data.keys() & {"grid", "variants"}:
        data = {"base": "vesicle.toml", **data}
        (folder / "page.toml").write_text(text if "base" in tomllib.loads(text) else f'base = "vesicle.toml"\n{text}')
        assert readGrid(folder / "page.toml")
        return
    assert parseConfig({"mesh": {"icosphere": 2}, **data})
    (folder / "cell.toml").write_text(text)


CODE = [page for page in PAGES if any(lang in ("python", "bash", "toml") for lang, _ in blocksOf(page))]


@pytest.mark.parametrize("page", [page for page in CODE if nameOf(page) not in ELSEWHERE], ids=nameOf)
def testCodeRuns(page, quick):
    if "pyvista" in page.read_text(encoding="utf-8") and not canRender():
        pytest.skip("there is no pyvista, or nothing that it could draw with")
    names = scene()
    for language, text in blocksOf(page):
        if language == "python":
            # Fewer steps, but for those that find a step size
            text = re.sub(r"(?<!adaptStepSize\(simulation, )\b(100|200|500|1000|5000)\b(?! \*)", "10", text)
            exec(compile(text, nameOf(page), "exec"), names)
        elif language == "bash":
            for line in re.sub(r"\\\n", "", text).splitlines():
                runCommand(line)
        elif language == "toml":
            readConfiguration(text, quick)


def examplesOf(docstring):
    """Return the blocks of code of a docstring."""
    return [textwrap.dedent(block) for block in re.findall(r"::\n\n((?:[ ]{4}.*\n|\n)+)", docstring + "\n")]


@pytest.mark.parametrize("name", sorted(mh.__all__))
def testEveryNameHasAnExampleThatRuns(name, quick):
    docstring = inspect.getdoc(getattr(mh, name)) or ""
    assert examplesOf(docstring), f"{name} has no example"
    names = scene()
    for example in examplesOf(docstring):
        code = compile(example, name, "exec")
        if name not in LONG:
            exec(code, names)
