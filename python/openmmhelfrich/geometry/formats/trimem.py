"""Meshes of TriMem's checkpoints, .h5: HDF5 files with the datasets points, (N, 3), and cells, (T, 3)."""

import io

import h5py
import numpy as np
from numpy.typing import NDArray

from ...files import requireStored
from .content import Content


def read(content: bytes) -> Content:
    """Read the mesh of a checkpoint's bytes."""
    try:
        with h5py.File(io.BytesIO(content), "r") as file:
            points, cells = (
                _rows(file, name, kinds, len(content)) for name, kinds in (("points", "f"), ("cells", "iu"))
            )
    except ValueError:
        raise
    except Exception as error:  # what the library raises at a damaged file may be anything
        raise ValueError(f"it is not an HDF5 file, or not a complete one: {' '.join(str(error).split())}") from None
    return Content.ofTriangles(points.astype(np.float64), cells.astype(np.int64))


def _rows(file: h5py.File, name: str, kinds: str, size: int) -> NDArray:
    """Return a dataset of rows of three numbers of some kinds, in a file of a size."""
    data = file.get(name) if isinstance(file.get(name, getlink=True), h5py.HardLink) else None
    if not isinstance(data, h5py.Dataset) or data.external or data.is_virtual:
        raise ValueError(f"it has no dataset '{name}'; a checkpoint of TriMem has 'points' and 'cells'")
    if data.ndim != 2 or data.shape[1] != 3 or data.dtype.kind not in kinds:
        what = "numbers" if kinds == "f" else "integers"
        raise ValueError(f"'{name}' has the shape {data.shape} of {data.dtype}; it must be (N, 3), of {what}")
    requireStored(f"'{name}'", data.nbytes, size)
    return np.asarray(data[()])


def content(points: NDArray[np.float64], triangles: NDArray[np.integer]) -> bytes:
    """Return the bytes of the mesh of a checkpoint, as TriMem and what reads its checkpoints expect them."""
    result = io.BytesIO()
    with h5py.File(result, "w") as file:
        for name, data in (("points", points.astype(np.float64)), ("cells", triangles.astype(np.int32))):
            file.create_dataset(name, data=data, compression="gzip", compression_opts=4)
    return result.getvalue()
