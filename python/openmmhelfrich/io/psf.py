"""PSF files: the topology that goes with a DCD trajectory."""

from collections.abc import Sequence

from openmm import app

from ..files import PathLike, replacing

# Columns of the extended format (CHARMM's EXT).  Ten digits an index leave room for any mesh, and blanks between all
# fields let readers that split at blanks (mdtraj, MDAnalysis, NAMD) and readers that count columns (VMD, OpenMM) agree.
_ATOM = "{:10d} {:<8.8s} {:<8.8s} {:<8.8s} {:<8.8s} {:<4.4s} {:>13s} {:>13s}{:8d}\n"


def writePSF(
    file: PathLike, topology: app.Topology, mass: float | Sequence[float] = 1.0, types: Sequence[str] = ()
) -> None:
    """Write the atoms and bonds of a Topology to a PSF file, replacing one that exists in a single step.

    VMD, mdtraj and MDAnalysis read it as the partner of a DCD trajectory, for any number of atoms.  The bonds are those
    that the Topology has: for a membrane whose edges flip, those at its creation.

    ::

        mh.writePSF("vesicle.psf", mesh.topology())

    Parameters
    ----------
    file : path
        the file to write
    topology : openmm.app.Topology
        what to write; a chain becomes a segment
    mass : float or sequence of float
        the mass of each atom, in Da: one for all, or a list
    types : sequence of str
        the types of the first atoms, as the names of their species, of which four characters are written, with _ for
        blanks; that of another atom is its name
    """
    atoms, bonds = list(topology.atoms()), list(topology.bonds())
    masses = [mass] * len(atoms) if isinstance(mass, (int, float)) else mass
    with replacing(file) as part, open(part, "w", encoding="utf-8") as out:
        out.write(f"PSF EXT\n\n{1:10d} !NTITLE\n REMARKS a triangulated membrane: an atom a vertex, a bond an edge\n\n")
        out.write(f"{len(atoms):10d} !NATOM\n")
        for i, atom in enumerate(atoms):
            residue = atom.residue
            # No field may be blank.
            own = "_".join(types[i].split()) if i < len(types) else atom.name
            names = (name or "X" for name in (residue.chain.id, residue.id, residue.name, atom.name, own))
            out.write(_ATOM.format(i + 1, *names, "0.000000", f"{masses[i]:.6g}", 0))
        out.write(f"\n{len(bonds):10d} !NBOND: bonds\n")
        for first in range(0, len(bonds), 4):
            out.write("".join(f"{a.index + 1:10d}{b.index + 1:10d}" for a, b, *_ in bonds[first : first + 4]) + "\n")
        for section in ("NTHETA: angles", "NPHI: dihedrals", "NIMPHI: impropers", "NDON: donors", "NACC: acceptors"):
            out.write(f"\n{0:10d} !{section}\n\n")
