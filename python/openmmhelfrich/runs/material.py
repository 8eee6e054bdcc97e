"""The species of a configuration: which vertices each has at the start, and what a HelfrichForce is told of them."""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra

from ..geometry.connectivity import imagesInBox
from ..geometry.mesh import Mesh
from ..helfrich import HelfrichForce
from ..sampling.conditions import LINE_TENSION
from .config import Config, conditionParts
from .sections import SpeciesSection, checkShares

# In mean edge lengths.
SMALLEST_RADIUS = 0.1


def speciesOf(config: Config, mesh: Mesh) -> NDArray[np.intc]:
    """Return the number of the species of each vertex that a resolved Config asks for, none if there are none.

    A mesh that has species keeps them.
    """
    field, own = config.mesh.species_field, mesh.species
    if not config.species or (own is None and field is None):
        return placeSpecies(config.species, mesh, config.sampling.seed or 0)
    if own is None:
        own = Mesh.read(str(config.mesh.file), speciesField=field).species
    assert own is not None
    what = "the mesh has species, of which one" if field is None else f"[mesh] species_field {field}"
    if len(own) != len(mesh.vertices):
        raise ValueError(f"{what} has {len(own)} values, and the mesh {len(mesh.vertices)} vertices; give as many")
    count = len(config.species)
    if own.max() >= count:
        raise ValueError(
            f"{what} has the number {own.max()}; with {count} [[species]] they must be whole numbers from 0 to "
            f"{count - 1}"
        )
    return own.astype(np.intc)


# Of more species not all pairs are made: those of 1000 take 0.4 s, of 2000 1.5 s and 200 MB.
MOST_SPECIES_OF_PAIRS = 1000


def requireOnePlace(config: Config, mesh: Mesh) -> None:
    """Raise a ValueError if a mesh has species, and species of a Config have places on it."""
    placed = [each.name for each in config.species if not each.isRest]
    if placed and mesh.species is not None:
        raise ValueError(
            f"the mesh has species of its own, and the species {placed[0]} has a fraction or vertices; give one of "
            "them, as with mesh.species = None"
        )


def placeSpecies(species: Sequence[SpeciesSection], mesh: Mesh, seed: int) -> NDArray[np.intc]:
    """Return the number of the species of each vertex.

    Lists of vertices come first, then places, and then what is at random, each in the order of the species; the rest is
    that of the species that has no place.

    Raises
    ------
    ValueError
        if there is no such vertex, two species have the same, or vertices are left over
    """
    count = len(mesh.vertices)
    if not species:
        return np.zeros(0, dtype=np.intc)
    checkShares(species)
    result = np.full(count, -1, dtype=np.intc)
    for i, each in enumerate(species):
        if each.vertices is not None:
            _take(result, i, species, np.asarray(each.vertices, dtype=np.int64))
    ranked = sorted(
        (i for i, each in enumerate(species) if each.fraction is not None), key=lambda i: species[i].region == "random"
    )
    counts, random = _counts([species[i].fraction or 0.0 for i in ranked], count), np.random.default_rng(seed)
    for i, number in zip(ranked, counts):
        free = np.flatnonzero(result < 0)
        if number > len(free):
            raise ValueError(
                f"the species {species[i].name} asks for {number} of {count} vertices, and {len(free)} are left"
            )
        result[free[np.argsort(_distances(species[i], mesh, random)[free], kind="stable")[:number]]] = i
    rest = [i for i, each in enumerate(species) if each.isRest]
    left = np.count_nonzero(result < 0)
    if left and not rest:
        raise ValueError(
            f"{left} of {count} vertices are of no species; let one species have neither fraction nor vertices"
        )
    result[result < 0] = rest[0] if rest else -1
    return result


def setMaterial(force: HelfrichForce, config: Config, vertexSpecies: NDArray[np.intc], kT: float) -> None:
    """Give a HelfrichForce the moduli of a resolved Config, which are those of species where there are some."""
    membrane = config.membrane
    force.setSpontaneousCurvature(membrane.spontaneous_curvature)
    if not config.species:
        force.setBendingModulus(membrane.bending_modulus * kT)
        force.setGaussianModulus(membrane.gaussian_modulus * kT)
        return
    for each in config.species:
        bending = modulusOf(each.bending_modulus, membrane.bending_modulus)
        gaussian = modulusOf(each.gaussian_modulus, membrane.gaussian_modulus)
        force.addSpecies(bending * kT, each.spontaneous_curvature, gaussian * kT)
    force.setVertexSpecies(vertexSpecies)
    for (a, b), value in lineTensionsOf(config).items():
        force.setLineTension(a, b, value * kT)
    for (a, b), value in _byNumbers(config, membrane.pair_energies).items():
        force.setPairEnergy(a, b, value * kT)


def numbered(config: Config, name: str) -> str:
    """Return the name of a condition with the numbers of species in place of their names."""
    key, inside = conditionParts(name)
    names = [each.name for each in config.species]
    numbers = sorted(names.index(each) for each in inside.split(", ")) if inside else []
    return f"{key}[{','.join(map(str, numbers))}]" if numbers else key


def requireKnown(config: Config, name: str) -> None:
    """Raise a ValueError if a condition is of a species that there is not, or a line tension of one alone."""
    key, inside = conditionParts(name)
    names = [each.name for each in config.species]
    given = inside.split(", ") if inside else []
    for each in given:
        if each not in names:
            known = f"the species are {', '.join(names)}" if names else "there are no [[species]]"
            raise ValueError(f"it has a {key} of '{inside}', and no species is called '{each}'; {known}")
    if key == LINE_TENSION and given and len(set(given)) < 2:
        raise ValueError(f"it has a {key} of '{inside}'; it must be of two different species")
    if key == "pair_energy" and len(names) < 2:
        raise ValueError(f"it has a {key} of '{inside}', which has no effect with one species")


def modulusOf(own: float | None, membranes: float) -> float:
    """Return a modulus of a species, which is the membrane's where it has none of its own."""
    return membranes if own is None else own


def bendingModulusOf(config: Config) -> float:
    """Return the greatest bending modulus, in kT."""
    membrane = config.membrane.bending_modulus
    return max((modulusOf(each.bending_modulus, membrane) for each in config.species), default=membrane)


def spontaneousCurvatureOf(config: Config) -> float:
    """Return the spontaneous curvature that is greatest in size."""
    return max(_spontaneousCurvaturesOf(config), key=abs)


def _spontaneousCurvaturesOf(config: Config) -> list[float]:
    """Return the spontaneous curvature of each species, with the membrane's own, or this alone if there are none."""
    own = config.membrane.spontaneous_curvature
    return [own + each.spontaneous_curvature for each in config.species] or [own]


def requireResolved(what: str, config: Config, length: float) -> None:
    """Raise a ValueError if a spontaneous curvature, which what names, asks for much smaller spheres than the mean edge
    is long.  Where there are species it is that of one of them, with the membrane's.
    """
    most, found = 2 / (SMALLEST_RADIUS * length), spontaneousCurvatureOf(config)
    if abs(found) > most:
        included = ", with the membrane's own," if config.membrane.spontaneous_curvature else ""
        names = [f" of '{each.name}'{included}" for each in config.species] or [""]
        which, unit = names[_spontaneousCurvaturesOf(config).index(found)], config.mesh.length_unit
        raise ValueError(
            f"{what}{which} is {found:g} 1/{unit}; its size must be at most {most:.3g}, where spheres of the "
            f"radius 2/C_0 are {SMALLEST_RADIUS:g} of the mean edge length, {length:.3g} {unit}: one may be in another "
            "unit of length"
        )


def gaussianStepOf(config: Config) -> float:
    """Return by how much the Gaussian moduli of species differ at most, in kT."""
    moduli = [modulusOf(each.gaussian_modulus, config.membrane.gaussian_modulus) for each in config.species]
    return max(moduli) - min(moduli) if moduli else 0.0


def lineTensionsOf(config: Config) -> dict[tuple[int, int], float]:
    """Return the line tensions, in kT per length unit, by the numbers of two species."""
    count, tension = len(config.species), config.membrane.line_tension
    if isinstance(tension, dict):
        return _byNumbers(config, tension)
    if tension and count > MOST_SPECIES_OF_PAIRS:
        raise ValueError(
            f"[membrane] line_tension is {tension:g} between all of {count} species, which makes "
            f"{count * (count - 1) // 2} pairs; give a table of the pairs that have one, or at most "
            f"{MOST_SPECIES_OF_PAIRS} species"
        )
    return {(a, b): tension for b in range(count) for a in range(b)} if tension else {}


def _byNumbers(config: Config, values: dict[str, float]) -> dict[tuple[int, int], float]:
    """Return what is given of pairs of species, by the numbers of the two."""
    names = [each.name for each in config.species]
    numbers = {pair: [names.index(name) for name in pair.split(", ")] for pair in values}
    return {(a, b): values[pair] for pair, (a, b) in numbers.items()}


def _take(result: NDArray[np.intc], i: int, species: Sequence[SpeciesSection], vertices: NDArray[np.int64]) -> None:
    """Give a species vertices by their indices."""
    count = len(result)
    beyond = vertices[vertices >= count]
    if len(beyond):
        raise ValueError(
            f"the species {species[i].name} has the vertex {beyond[0]}; the mesh has {count}, from 0 to {count - 1}"
        )
    taken = vertices[(result[vertices] >= 0) & (result[vertices] != i)]
    if len(taken):
        raise ValueError(
            f"the vertex {taken[0]} is of the species {species[result[taken[0]]].name} and of {species[i].name}; it "
            "must be of one"
        )
    result[vertices] = i


def _counts(fractions: Sequence[float], count: int) -> list[int]:
    """Return whole numbers of vertices whose sums are those of the fractions, rounded."""
    ends = np.rint(np.cumsum([0.0, *fractions]) * count).astype(int)
    return np.diff(ends).tolist()


def _distances(species: SpeciesSection, mesh: Mesh, random: np.random.Generator) -> NDArray[np.float64]:
    """Return of each vertex how far it is from where a species is."""
    if species.region == "random":
        return random.random(len(mesh.vertices))
    direction = np.asarray(species.direction, dtype=float)
    heights = imagesInBox(mesh.vertices, mesh.images) @ (direction / np.linalg.norm(direction))
    if species.region != "patch" and np.ptp(heights) < 1e-9 * mesh.edgeLengths.mean():
        raise ValueError(
            f"the species {species.name} is in a {species.region} along {species.direction}, and the mesh is flat "
            "there; give another direction, or another region"
        )
    if species.region == "cap":
        return -heights
    if species.region == "stripe":
        return np.abs(heights - heights.mean())
    edges = mesh.edges
    graph = sparse.coo_matrix((mesh.edgeLengths, (edges[:, 0], edges[:, 1])), shape=(len(heights), len(heights)))
    return np.asarray(dijkstra(graph.tocsr(), directed=False, indices=int(np.argmax(heights))))
