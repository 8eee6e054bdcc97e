"""The structure of the package: who may import whom, what is loaded when, and that all that is public has types."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import openmmhelfrich as mh

SOURCE = Path(__file__).resolve().parent.parent / "python" / "openmmhelfrich"

# From the ground up: a module imports what is below it, or beside it on its own floor.
FLOORS = [
    ["display", "files", "helfrich", "installation", "messages", "optional", "tables", "units", "version"],
    ["geometry"],
    ["io"],
    ["sampling"],
    ["analysis"],
    ["pictures"],
    ["runs"],
    ["tradeoff"],
    ["cli"],
]
FLOOR_OF = {name: floor for floor, names in enumerate(FLOORS) for name in names}
MODULES = {
    ".".join(path.relative_to(SOURCE).with_suffix("").parts).removesuffix(".__init__"): path
    for path in sorted(SOURCE.rglob("*.py"))
    if path != SOURCE / "__init__.py"
}
TREES = {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in MODULES.items()}


def isModule(name):
    return name in MODULES or name == "helfrich"


def importsOf(name):
    """Return the modules of the package that one imports, anywhere in it, also inside of functions."""
    package = name.split(".") if MODULES[name].name == "__init__.py" else name.split(".")[:-1]
    found = set()
    for node in ast.walk(TREES[name]):
        if isinstance(node, ast.ImportFrom):
            assert node.module is None or not node.module.startswith("openmmhelfrich"), f"{name} imports absolutely"
            if node.level > 0:
                home = package[: len(package) + 1 - node.level] + (node.module.split(".") if node.module else [])
                parts = {".".join([*home, alias.name]) for alias in node.names}
                found |= {part for part in parts if isModule(part)}
                if any(not isModule(part) for part in parts):
                    found.add(".".join(home))
    return found


IMPORTS = {name: importsOf(name) for name in MODULES}


def test_every_module_has_a_floor():
    assert {name.split(".")[0] for name in MODULES} | {"helfrich"} == set(FLOOR_OF)


def test_imports_lead_down():
    def floorOf(name):
        return FLOOR_OF[name.split(".")[0]]

    up = [(name, other) for name, others in IMPORTS.items() for other in others if floorOf(other) > floorOf(name)]
    assert not up


def test_no_imports_lead_in_a_circle():
    left = {name: {other for other in others if other in MODULES} for name, others in IMPORTS.items()}
    while ground := [name for name, others in left.items() if not others]:
        left = {name: others - set(ground) for name, others in left.items() if name not in ground}
    assert not left


def loaded(program, *names):
    """Return which modules a program has loaded at its end."""
    program += f"\nimport sys; print(*[name for name in {names} if name in sys.modules])"
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()


@pytest.mark.parametrize(
    "program",
    [
        "import openmmhelfrich",
        "import openmmhelfrich.units, openmmhelfrich.tables",
        "from openmmhelfrich.runs.configfile import defaultText; defaultText()",
        "from openmmhelfrich.runs.config import parseConfig\n"
        "parseConfig({'mesh': {'icosphere': 2}, 'membrane': {'bending_modulus': '80 kJ/mol'}})",
        "import openmmhelfrich.cli",
    ],
)
def test_what_loads_no_openmm(program):
    assert loaded(program, "openmm", "openmmhelfrich.helfrich") == []


def test_what_is_public():
    assert set(mh.__all__) <= set(dir(mh)) and "__version__" in dir(mh) and "runs" in dir(mh)
    for name in dir(mh):
        assert getattr(mh, name) is not None
    assert mh.Mesh is mh.geometry.mesh.Mesh and mh.analysis.describeShape is mh.describeShape
    with pytest.raises(AttributeError, match="'openmmhelfrich' has no attribute 'meshes'"):
        mh.meshes  # noqa: B018


def functionsOf(body):
    """Yield the definition of each public function and method, and of each constructor."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from functionsOf(node.body)
        elif isinstance(node, ast.FunctionDef) and (not node.name.startswith("_") or node.name == "__init__"):
            yield node


def isTyped(function):
    arguments = function.args
    every = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs, arguments.vararg, arguments.kwarg]
    isComplete = all(a is None or a.annotation is not None or a.arg in ("self", "cls") for a in every)
    return isComplete and (function.returns is not None or function.name == "__init__")


def test_everything_public_has_types():
    untyped = [f"{name}.{f.name}" for name, tree in TREES.items() for f in functionsOf(tree.body) if not isTyped(f)]
    assert not untyped
