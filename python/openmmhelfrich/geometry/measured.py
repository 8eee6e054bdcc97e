"""What is asked of a mesh again and again, measured once: of a large one each measure takes a while."""

from functools import cached_property

from .mesh import Mesh


class MeasuredMesh:
    """A mesh that stays as it is, whose measures are computed when they are first asked for.

    Attributes
    ----------
    mesh : Mesh
        the mesh
    surfaces : list of Mesh
        each connected membrane, in the order of first triangles
    areas, meanCurvatures : list of float
        the area, and the integrated mean curvature, of each, in nm^2 and nm
    volumes : list of float or None
        the volume of each, in nm^3; None of one that is periodic
    meanEdgeLength : float
        the mean length of all edges, in nm
    """

    def __init__(self, mesh: Mesh):
        self.mesh = mesh

    @cached_property
    def surfaces(self) -> list[Mesh]:
        return self.mesh.components()

    @cached_property
    def areas(self) -> list[float]:
        return [surface.area for surface in self.surfaces]

    @cached_property
    def volumes(self) -> list[float | None]:
        return [None if surface.isPeriodic else surface.volume for surface in self.surfaces]

    @cached_property
    def meanCurvatures(self) -> list[float]:
        return [surface.vertexMeanCurvatures.sum() for surface in self.surfaces]

    @cached_property
    def meanEdgeLength(self) -> float:
        return self.mesh.edgeLengths.mean()
