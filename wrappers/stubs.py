"""Writes the stubs that tell editors and type checkers what the package has: of the extension, from what SWIG makes of
the headers, and of the package itself, whose names are imported when they are first asked for.

    python wrappers/stubs.py            writes them
    python wrappers/stubs.py --check    ends with exit code 1 if one is not as it would be written
"""

import ast
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import openmm.version

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "python" / "openmmhelfrich"
HEAD = '"""Written by wrappers/stubs.py."""\n\n'
# What arguments and results of C++ types are in Python.
ARGUMENTS = {
    "double": "Number",
    "int": "SupportsIndex",
    "long long": "SupportsIndex",
    "bool": "bool",
    "std::string const &": "str",
    "std::vector< std::array< int,3 > > const &": "ArrayLike",
    "std::vector< int > const &": "ArrayLike",
    "Integrator": "openmm.Integrator",
    "Force": "openmm.Force",
    "Context": "openmm.Context",
}
RESULTS = {
    "void": "None",
    "double": "float",
    "int": "int",
    "long long": "int",
    "bool": "bool",
    "std::string": "str",
    "std::string const &": "str",
    "std::vector< std::string >": "tuple[str, ...]",
    "std::vector< std::array< int,3 > > const &": "NDArray[np.int32]",
    "std::vector< std::array< int,3 > > &": "NDArray[np.int32]",
    "std::vector< int > const &": "NDArray[np.int32]",
    "std::vector< int > &": "NDArray[np.int32]",
    "HelfrichPlugin::HelfrichEnergyTerms": "dict[str, unit.Quantity]",
}
# What methods that are written in Python take and return.
PYTHON_ARGUMENTS = {
    "fraction": "Number",
    "probability": "Number",
    "object": "Any",
    "index": "SupportsIndex",
    "shearWaves": "ShearWaveIntegrator",
}
PYTHON_RESULTS = {
    "cast": "{name}",
    "isinstance": "bool",
    "getIntegrator": "Any",
    "getMove": "Any",
    "getShearWaveIntegrator": "ShearWaveIntegrator",
    "getNumTrajectories": "int",
    "getNumAcceptedTrajectories": "int",
    "getNumDivergedTrajectories": "int",
    "__repr__": "str",
    "__dir__": "list[str]",
}
# What signatures cannot tell: constructors that are overloaded, and methods that moves lend to a mixture.
CONSTRUCTORS = {
    "HybridMonteCarloIntegrator": """\
    @overload
    def __init__(
        self,
        temperature: Number,
        stepSize: Number,
        stepsPerTrajectory: SupportsIndex = ...,
        flipFraction: Number = ...,
        flipProbability: Number = ...,
        engine: str = ...,
    ) -> None: ...
    @overload
    def __init__(
        self, trajectory: openmm.Integrator, flips: EdgeFlipIntegrator | None = ..., flipProbability: Number = ...
    ) -> None: ...
""",
}
LENDER, BORROWER = "HamiltonianTrajectoryIntegrator", "HybridMonteCarloIntegrator"


def annotatedModule() -> ast.Module:
    """Return the Python part of the extension as SWIG makes it, with the C++ types of arguments and results."""
    include = Path(openmm.version.openmm_library_path).parent / "include"
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(
            [
                *("swig", "-python", "-c++", "-doxygen", "-w302", "-features", "python:annotations=c"),
                *(f"-I{path}" for path in (ROOT / "wrappers", ROOT / "openmmapi" / "include", include)),
                *("-outdir", folder, "-o", f"{folder}/helfrich.cpp", str(ROOT / "wrappers" / "helfrich.i")),
            ],
            check=True,
        )
        return ast.parse((Path(folder) / "helfrich.py").read_text(encoding="utf-8"))


def extensionStub() -> str:
    """Return the stub of the extension."""
    tree = annotatedModule()
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    shown = [node for node in classes if not node.name.startswith("_") or node.name == "_Mixture"]
    settings = next(ast.literal_eval(n.value) for n in tree.body if _assigns(n, "_TRAJECTORY_SETTINGS"))
    lent = {verb + name for name in settings for verb in ("get", "set")}
    lender = next(node for node in shown if node.name == LENDER)
    borrowed = [node for node in _functions(lender) if node.name in lent]
    imports = """\
import dataclasses
from typing import Any, Protocol, SupportsIndex, TypeAlias, overload

import numpy as np
import openmm
from numpy.typing import ArrayLike, NDArray
from openmm import unit

class HasUnit(Protocol):
    def value_in_unit(self, unit: Any) -> Any: ...

Number: TypeAlias = float | HasUnit
"""
    parts = [_classStub(node, borrowed if node.name == BORROWER else []) for node in shown]
    return HEAD + imports + "\n" + "\n".join([*parts, "def _setStepListener(listener: Any) -> None: ...\n"])


def packageStub() -> str:
    """Return the stub of the package, from what it says to have where."""
    tree = ast.parse((PACKAGE / "__init__.py").read_text(encoding="utf-8"))
    homes = next(ast.literal_eval(node.value) for node in tree.body if _assigns(node, "_HOMES"))
    packages = next(ast.literal_eval(node.value) for node in tree.body if _assigns(node, "_PACKAGES"))
    lines = [f"from . import {name} as {name}" for name in packages]
    lines += [f"from .{module} import {name} as {name}" for module, names in homes.items() for name in names]
    names = sorted(name for names in homes.values() for name in names if not name.startswith("__"))
    return HEAD + "\n".join(lines) + f"\n\n__all__ = {names!r}\n"


def _assigns(node: ast.stmt, name: str) -> bool:
    return isinstance(node, ast.Assign) and [ast.unparse(target) for target in node.targets] == [name]


def _functions(node: ast.ClassDef) -> list[ast.FunctionDef]:
    return [part for part in node.body if isinstance(part, ast.FunctionDef)]


def _classStub(node: ast.ClassDef, more: list[ast.FunctionDef]) -> str:
    bases = ", ".join(ast.unparse(base) for base in node.bases if ast.unparse(base) != "object")
    fields = [part for part in node.body if isinstance(part, ast.AnnAssign)]
    head = f"class {node.name}({bases}):" if bases else f"class {node.name}:"
    lines = ["@dataclasses.dataclass(frozen=True, eq=False)", head] if fields else [head]
    for field in fields:
        kind = ast.unparse(field.annotation)
        lines.append(f"    {ast.unparse(field.target)}: {_FIELDS.get(ast.unparse(field.target), kind)}")
    body = [text for part in [*_functions(node), *more] for text in _methodStub(node.name, part)]
    return "\n".join([*lines, *body] if fields or body else [head + " ..."]) + "\n"


_FIELDS = {
    "surfaces": "tuple[HelfrichSurfaceGeometry, ...]",
}


def _methodStub(name: str, node: ast.FunctionDef) -> Iterator[str]:
    if node.name == "__init__" and name in CONSTRUCTORS:
        yield CONSTRUCTORS[name].rstrip()
        return
    isPublic = not node.name.startswith("_") or node.name in ("__init__", "__getattr__")
    isOpen = node.args.vararg is not None  # of what is overloaded, or the constructor of an abstract class
    if not isPublic or (isOpen and node.name == "__init__"):
        return
    if any("property" in ast.unparse(decorator) for decorator in node.decorator_list):
        return
    if any(ast.unparse(decorator) == "classmethod" for decorator in node.decorator_list):
        return
    isStatic = any(ast.unparse(decorator) == "staticmethod" for decorator in node.decorator_list)
    if isStatic:
        yield "    @staticmethod"
    yield f"    def {node.name}({', '.join(_argumentStubs(node))}) -> {_resultStub(name, node)}: ..."


def _argumentStubs(node: ast.FunctionDef) -> Iterator[str]:
    arguments = node.args.args
    optional = len(arguments) - len(node.args.defaults)
    for i, argument in enumerate(arguments):
        if argument.arg == "self":
            yield "self"
            continue
        default = " = ..." if i >= optional else ""
        yield f"{argument.arg}: {_argumentType(argument)}{default}"
    if node.args.vararg is not None:
        yield f"*{node.args.vararg.arg}: Any"


def _argumentType(argument: ast.arg) -> str:
    if argument.annotation is None:
        return "str" if argument.arg == "name" else PYTHON_ARGUMENTS[argument.arg]
    return _lookUp(ARGUMENTS, ast.literal_eval(argument.annotation))


def _resultStub(name: str, node: ast.FunctionDef) -> str:
    if node.name == "__init__" or node.name.startswith("set"):
        return "None"
    if node.returns is None:
        verb = "None" if node.name.startswith("add") else "Any" if node.name == "__getattr__" else "float"
        return PYTHON_RESULTS.get(node.name, verb).format(name=name)
    kind = ast.literal_eval(node.returns)
    if "&," in kind.replace(" ", ""):  # numbers that come back through references
        return "list[int]" if "double" not in kind else "list[Any]"
    return "unit.Quantity" if kind == "double" and "unit.Quantity(val" in ast.unparse(node) else _lookUp(RESULTS, kind)


def _lookUp(kinds: dict[str, str], kind: str) -> str:
    """Return what a C++ type is in Python: what the table says, or a class of the extension."""
    own = re.fullmatch(r"HelfrichPlugin::(\w+)(?: const)?(?: [*&])?", kind)
    return kinds[kind] if kind in kinds or own is None else own[1]


def main() -> None:
    stubs = {PACKAGE / "helfrich.pyi": extensionStub(), PACKAGE / "__init__.pyi": packageStub()}
    stubs = {file: _laidOut(text) for file, text in stubs.items()}
    if "--check" not in sys.argv[1:]:
        for file, text in stubs.items():
            file.write_text(text, encoding="utf-8")
        return
    stale = [file for file, text in stubs.items() if not file.exists() or file.read_text(encoding="utf-8") != text]
    for file in stale:
        print(f"{file.relative_to(ROOT)} is not what python wrappers/stubs.py writes", file=sys.stderr)
    sys.exit(1 if stale else 0)


def _laidOut(text: str) -> str:
    command = ["ruff", "format", "--stdin-filename", str(PACKAGE / "stub.pyi"), "-"]
    text = subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout
    command = ["ruff", "check", "--quiet", "--fix-only", "--stdin-filename", str(PACKAGE / "stub.pyi"), "-"]
    return subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout


if __name__ == "__main__":
    main()
