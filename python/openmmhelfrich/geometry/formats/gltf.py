"""glTF, .gltf and .glb, by the library trimesh: the only one of those that were compared which needs nothing but numpy.

The vertices of such a file are apart where normals or texture coordinates differ; here they are one where their
positions are the same.
"""

from pathlib import Path

import numpy as np

from ...messages import inLine
from .content import Content


@np.errstate(all="ignore")  # what is no number is told by Mesh
def read(path: Path) -> Content:
    """Read all triangles of a file, each node where it stands in the scene."""
    import trimesh

    try:
        scene = trimesh.load_scene(path, process=False)
    except FileNotFoundError as error:
        raise ValueError(f"it refers to another file, {inLine(error)}, which is not there") from None
    parts = [scene.geometry[name] for name in scene.geometry]
    others = [part for part in parts if not isinstance(part, trimesh.Trimesh)]
    if len(parts) == len(others):
        raise ValueError("the mesh has no triangles")
    mesh = scene.to_mesh()
    result = Content.ofLooseTriangles(np.asarray(mesh.vertices)[mesh.faces])
    result.noteLeftOut(len(others), "parts of points or lines")
    return result
