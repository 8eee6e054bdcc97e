"""The topology of a mesh for OpenMM, whose atoms and bonds are made when somebody asks for them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from openmm import app

from . import atomnames, connectivity


class MeshTopology(app.Topology):
    """An openmm.app.Topology of a mesh: a residue for each connected membrane, an atom for each vertex, a bond for each
    edge; and a residue and an atom for each bead, in a chain of their own.

    These are Python objects, which take 2 kB a vertex.  A simulation does not use them; they are made when one is asked
    for.
    """

    _MADE_LATER = ("_chains", "_numResidues", "_bonds")

    def __init__(self, triangles: NDArray[np.integer], numVertices: int, numBeads: int = 0):
        """Create a MeshTopology from arrays; the triangles are copied."""
        super().__init__()
        self._triangles, self._numVertices, self._numBeads = triangles.copy(), numVertices, numBeads
        self._numAtoms = numVertices + numBeads
        for name in self._MADE_LATER:
            delattr(self, name)

    def __getattr__(self, name: str) -> Any:
        if name not in self._MADE_LATER:
            raise AttributeError(f"a Topology has no attribute '{name}'")
        self._make()
        return getattr(self, name)

    def _make(self) -> None:
        self._chains: list[Any] = []
        self._bonds: list[Any] = []
        self._numResidues = self._numAtoms = 0
        chain = self.addChain("M")
        _, label = connectivity.labelComponents(self._triangles, self._numVertices)
        atoms: list[Any] = []
        residue, current = None, None
        for membrane in label.tolist():
            if membrane != current:
                residue, current = self.addResidue("MEM", chain, id=str(membrane + 1)), membrane
            atoms.append(self.addAtom(atomnames.nameOf(len(atoms)), None, residue))
        edges = connectivity.edgesOf(self._triangles, self._numVertices)
        for i, j in atomnames.orderOfBonds(edges, self._numVertices).tolist():
            self.addBond(atoms[i], atoms[j])
        beads = self.addChain("B") if self._numBeads else None
        for bead in range(self._numBeads):
            self.addAtom("B", None, self.addResidue("BEA", beads, id=str(bead + 1)))
