"""A program: reads a file with VTK and leaves its points and cells as arrays in another.  See vtkfiles."""

import os
import resource
import sys
from typing import Any

FIELD = "field "  # what names of arrays of points begin with


def main(source: str, output: str) -> None:
    """Read the source and write points, types, sizes and corners of cells to the output."""
    for name, kind in (("READER_BYTES", resource.RLIMIT_DATA), ("READER_SECONDS", resource.RLIMIT_CPU)):
        limit = int(os.environ[name])
        resource.setrlimit(kind, (limit, limit + 1))
    import numpy as np

    data = _read(source)
    types, sizes, corners = _cells(data)
    points = _array(data.GetPoints().GetData()) if data.GetPoints() else np.zeros((0, 3))
    fields = {f"{FIELD}{name}": values for name, values in _fields(data).items()}
    np.savez(output, points=points, types=types, sizes=sizes, corners=corners, **fields)


def _read(source: str) -> Any:
    """Return the polygonal data or the grid of a file, or end with what VTK says."""
    reader = _reader(source)
    errors: list[str] = []
    reader.AddObserver("ErrorEvent", lambda *_: errors.append(""))
    reader.SetFileName(source)
    reader.Update()
    data = reader.GetOutput()
    if errors or data is None or reader.GetErrorCode():
        sys.exit(1)
    if not (data.IsA("vtkPolyData") or data.IsA("vtkUnstructuredGrid")):
        sys.exit(f"it holds a {data.GetClassName()}; it must hold polygonal data or an unstructured grid")
    return data


def _reader(source: str) -> Any:
    suffix = source.lower().rsplit(".", 1)[-1]
    if suffix == "vtk":
        from vtkmodules.vtkIOLegacy import vtkGenericDataObjectReader

        reader = vtkGenericDataObjectReader()
        reader.ReadAllScalarsOn()
        reader.ReadAllFieldsOn()
        return reader
    from vtkmodules import vtkIOXML

    return vtkIOXML.vtkXMLPolyDataReader() if suffix == "vtp" else vtkIOXML.vtkXMLUnstructuredGridReader()


def _cells(data: Any) -> tuple[Any, ...]:
    """Return the types, sizes and corners of all cells, in VTK's order."""
    import numpy as np

    if data.IsA("vtkUnstructuredGrid"):
        types = [_array(data.GetCellTypes())] if data.GetNumberOfCells() else []
        groups = [data.GetCells()]
    else:
        groups = [data.GetVerts(), data.GetLines(), data.GetPolys(), data.GetStrips()]
        types = [np.full(group.GetNumberOfCells(), kind) for group, kind in zip(groups, (2, 4, 7, 6))]
    sizes = [np.diff(_array(group.GetOffsetsArray())) for group in groups]
    corners = [_array(group.GetConnectivityArray()) for group in groups]
    return tuple(
        np.concatenate([np.zeros(0, dtype=np.int64), *parts]).astype(np.int64) for parts in (types, sizes, corners)
    )


def _fields(data: Any) -> dict[str, Any]:
    """Return the arrays that have a number for each point, by name."""
    found = data.GetPointData()
    arrays = [found.GetArray(i) for i in range(found.GetNumberOfArrays())]
    return {a.GetName(): _array(a) for a in arrays if a is not None and a.GetName() and a.GetNumberOfComponents() == 1}


def _array(data: Any) -> Any:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    return vtk_to_numpy(data)


if __name__ == "__main__":
    main(*sys.argv[1:])
