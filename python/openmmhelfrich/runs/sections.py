"""The sections of a configuration, and their keys: what each means, its default, and what is allowed.

Lengths are in the mesh's ``length_unit``, areas and volumes in its powers, energies in kT at the run's temperature,
temperatures in K, masses in Da and times in ps.  The membrane's energy has no length scale of its own, so a unit of
length is a label: OpenMM's nm stands for it, whatever the size of the mesh.  A string with a unit, like "80 kJ/mol" or
"0.5 um", may stand for a number; it is converted while the file is read.
"""

import math
import sys
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainValidator,
    ValidationInfo,
    field_validator,
    model_validator,
)

from ..messages import quoted
from ..units import Scales, plainNumber, thermalEnergy

# What sizes numbers may have, and numbers of steps and the like.
LEAST, GREATEST, GREATEST_WHOLE = 1e-30, 1e30, 10**15
# What C++ counts: steps of a trajectory, moves of a step, iterations.
GREATEST_COUNT = 10**9


def _numbersIn(value: Any) -> Iterator[int | float]:
    """Yield the numbers of a value, of a list, or of a dict of lists."""
    if isinstance(value, (list, tuple, dict)):
        for part in value.values() if isinstance(value, dict) else value:
            yield from _numbersIn(part)
    elif isinstance(value, (int, float)):
        yield value


class Bounds(NamedTuple):
    """What numbers may be: from one to another, and whether also 0.  A type that checks its values itself has it among
    its metadata, for messages.
    """

    least: float = -GREATEST
    most: float = GREATEST
    hasZero: bool = True
    isOpen: bool = False  # less than the greatest

    @classmethod
    def of(cls, metadata: Sequence[Any]) -> "Bounds":
        """Return those of a key, from the metadata of its field."""
        found = cls()
        for each in metadata:
            if isinstance(each, Bounds):
                return each
            for name in ("gt", "ge"):
                if hasattr(each, name):
                    least = getattr(each, name)
                    found = found._replace(least=least, hasZero=name == "ge" and least == 0)
            for name in ("lt", "le"):
                if hasattr(each, name):
                    found = found._replace(most=getattr(each, name), isOpen=name == "lt")
        return found

    def __str__(self) -> str:
        zero = "0, or " if self.hasZero else ""
        if self.least < 0:
            return f"{zero}from {LEAST:g} to {GREATEST:g} in size"
        return f"{zero}from {max(self.least, LEAST):g} to {'less than ' if self.isOpen else ''}{self.most:g}"


POSITIVE = Bounds(0, hasZero=False)


def _scalesOf(info: ValidationInfo) -> Scales:
    return info.context or Scales(thermalEnergy(300.0))


def _quantity(kind: str) -> BeforeValidator:
    """Return what lets a number have a unit."""
    return BeforeValidator(lambda value, info: plainNumber(value, kind, _scalesOf(info)))


def _quantityOrAuto(kind: str, unitName: str) -> PlainValidator:
    """Return what lets a positive number have a unit, or be "auto"."""

    def validate(value: Any, info: ValidationInfo) -> Any:
        if value is None or value == "auto":
            return value
        number = plainNumber(value, kind, _scalesOf(info))
        isNumber = isinstance(number, (int, float)) and not isinstance(number, bool)
        if not isNumber or not (math.isfinite(number) and number > 0):
            raise ValueError(f"it must be a positive number, in {unitName}, or 'auto'")
        return float(number)

    return PlainValidator(validate)


def _weightOrAuto() -> PlainValidator:
    """Return what takes a weight of coarser meshes, from 0 to 1000, or "auto"."""

    def validate(value: Any) -> Any:
        if value == "auto":
            return value
        if not isinstance(value, (int, float)) or isinstance(value, bool) or not 0 <= value <= 1000:
            raise ValueError("it must be a number from 0 to 1000, or 'auto'")
        return float(value)

    return PlainValidator(validate)


def _perSurface(kind: str = "", above: float = -math.inf, most: float = math.inf) -> PlainValidator:
    """Return what takes a finite number above one and no more than another, or a list of them, one for each surface."""

    def one(value: Any, info: ValidationInfo) -> float:
        number = plainNumber(value, kind, _scalesOf(info)) if kind else value
        if not isinstance(number, (int, float)) or isinstance(number, bool):
            raise ValueError("it must be a number, or a list of numbers, one for each surface")
        if not abs(number) <= sys.float_info.max:
            raise ValueError("it must be a finite number")
        if number <= above:
            raise ValueError(f"it must be greater than {above:g}")
        if number > most:
            raise ValueError(f"it must be less than or equal to {most:g}")
        return float(number)

    def validate(value: Any, info: ValidationInfo) -> Any:
        if value == []:
            raise ValueError("it must have a number for each surface")
        if isinstance(value, list):
            return [one(number, info) for number in value]
        return None if value is None else one(value, info)

    return PlainValidator(validate)


Energy: TypeAlias = Annotated[float, _quantity("energy")]
Length: TypeAlias = Annotated[float, _quantity("length")]
Area: TypeAlias = Annotated[float, _quantity("area")]
Volume: TypeAlias = Annotated[float, _quantity("volume")]
Tension: TypeAlias = Annotated[float, _quantity("energy per area")]
Force: TypeAlias = Annotated[float, _quantity("energy per length")]
Pressure: TypeAlias = Annotated[float, _quantity("energy per volume")]
Curvature: TypeAlias = Annotated[float, _quantity("curvature")]
Time: TypeAlias = Annotated[float, _quantity("time")]
Mass: TypeAlias = Annotated[float, _quantity("mass")]
Temperature: TypeAlias = Annotated[float, _quantity("temperature")]
StepSize: TypeAlias = Annotated[Any, _quantityOrAuto("time", "ps"), POSITIVE]
Amplitude: TypeAlias = Annotated[Any, _quantityOrAuto("length", "length units"), POSITIVE]
MultilevelWeight: TypeAlias = Annotated[Any, _weightOrAuto(), Bounds(0, 1000)]
# Of each surface by itself: a number for all, or a list.
TargetArea: TypeAlias = Annotated[Any, _perSurface("area", above=0), POSITIVE]
TargetVolume: TypeAlias = Annotated[Any, _perSurface("volume", above=0), POSITIVE]
ReducedVolume: TypeAlias = Annotated[Any, _perSurface(above=0, most=1), Bounds(0, 1, hasZero=False)]
TargetAreaDifference: TypeAlias = Annotated[Any, _perSurface("area"), Bounds(hasZero=False)]


def _fileName(name: str) -> str:
    if "\0" in name:
        raise ValueError("it must be the name of a file, which has no null character")
    return name


# The least or the greatest coordinates of a box, and names of files: one, or a list.
Corner: TypeAlias = Annotated[list[Length], Field(min_length=3, max_length=3)]
FileName: TypeAlias = Annotated[str, Field(min_length=1), AfterValidator(_fileName)]
ForceFiles: TypeAlias = Annotated[
    list[FileName] | None,
    BeforeValidator(lambda value: [value] if isinstance(value, str) else value),
]


class Section(BaseModel):
    """A table of the file.

    Unknown keys, NaN and infinity are errors, and so are numbers in quotes that have no unit, and numbers so large or
    small that their products overflow.
    """

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _wholeNumbers(cls, values: Any) -> Any:
        """Take 1e3 for 1000 where a whole number is wanted."""
        if not isinstance(values, dict):
            return values
        whole = {name for name, field in cls.model_fields.items() if field.annotation in (int, int | None)}
        return {
            name: int(value) if name in whole and isinstance(value, float) and value.is_integer() else value
            for name, value in values.items()
        }

    @field_validator("*")
    @classmethod
    def _range(cls, value: Any, info: ValidationInfo) -> Any:
        for number in _numbersIn(value):
            if isinstance(number, int) and abs(number) > GREATEST_WHOLE:
                raise ValueError(f"it must be at most {GREATEST_WHOLE}")
            if isinstance(number, float) and number != 0 and not LEAST <= abs(number) <= GREATEST:
                bounds = Bounds.of(cls.model_fields[info.field_name or ""].metadata)
                raise ValueError(f"{'it' if number is value else 'each number'} must be {bounds}")
        return value


# The keys of the terms' moduli, in kT and powers of the unit of length.
MODULI = {
    "bending": "membrane.bending_modulus",
    "area": "membrane.area_modulus",
    "volume": "membrane.volume_modulus",
    "areaDifference": "membrane.area_difference_modulus",
    "tether": "tether.modulus",
    "repulsion": "repulsion.modulus",
    "tension": "membrane.tension",
    "pressure": "membrane.pressure",
    "gaussian": "membrane.gaussian_modulus",
}


def _separated(value: Any) -> Any:
    """Return a table of pairs of species with each pair written in one way."""
    if not isinstance(value, dict):
        return value
    pairs: dict[str, Any] = {}
    for pair, number in value.items():
        names = [name.strip() for name in str(pair).split(",")]
        if len(names) != 2 or not all(names):
            raise ValueError("each key must be the names of two species, separated by a comma, like 'lo, ld'")
        key = ", ".join(sorted(names))
        if key in pairs:
            raise ValueError(f"the pair {key} is given twice; give it once")
        pairs[key] = number
    return pairs


def _lineTension(value: Any, info: ValidationInfo) -> Any:
    """Return a number, or a table of numbers by pairs of species."""

    def one(given: Any) -> float:
        number = plainNumber(given, "energy per length", _scalesOf(info))
        if not isinstance(number, (int, float)) or isinstance(number, bool) or not math.isfinite(number):
            raise ValueError("it must be a finite number, or a table of such numbers by pairs, like {'lo, ld' = 2}")
        return float(number)

    def ofPair(pair: str, number: Any) -> float:
        try:
            return one(number)
        except ValueError as error:
            raise ValueError(f"the pair {pair} has {quoted(number)}; {error}") from None

    pairs = _separated(value)
    return {pair: ofPair(pair, number) for pair, number in pairs.items()} if isinstance(pairs, dict) else one(pairs)


# By the names of two species.
LineTensions: TypeAlias = Annotated[Any, PlainValidator(_lineTension)]
PairEnergies: TypeAlias = Annotated[dict[str, Energy], BeforeValidator(_separated)]


class MeshSection(Section):
    """The membrane to begin with: a file, a sphere, or a periodic sheet."""

    file: FileName | None = Field(
        None,
        description="mesh file (STL, PLY, OBJ, OFF, VTU, GMSH, glTF, TSI ...), relative to the configuration's folder",
    )
    icosphere: int | None = Field(
        None,
        ge=0,
        le=8,
        description="instead of a file: a sphere of radius 1, an icosahedron subdivided so often; 3 gives "
        "642 vertices, 4 gives 2562",
    )
    sheet: Annotated[Corner | None, POSITIVE] = Field(
        None,
        description="instead of a file: the width, the height and the length of the edges of a flat periodic sheet, in "
        "the plane z = 0 of a periodic box; see Mesh.sheet()",
    )
    scale: float = Field(
        1.0,
        gt=0,
        description="factor on the coordinates, which brings them into length_unit; for a sphere its radius",
    )
    remesh: int | None = Field(
        None,
        ge=12,
        description="make the mesh anew, of so many vertices and even triangles on the same surface; takes the extra "
        "openmm-helfrich[remesh]",
    )
    subdivide: int | None = Field(
        None,
        ge=1,
        le=6,
        description="divide each triangle in four equal ones so often; the surface stays as it is: a shape from "
        "equilibrium begins a run of a larger mesh",
    )
    repair: bool = Field(
        False,
        description="mend the mesh as the command repair does, and say what was done: weld corners, take away facets "
        "without area and specks, turn surfaces outwards",
    )
    species_field: str | None = Field(
        None,
        min_length=1,
        description="the name of an array of the file (VTU, VTK or PLY) with the number of the species of each vertex, "
        "from 0, in the order of [[species]]; final meshes have one called Species",
    )
    length_unit: str = Field(
        "nm",
        min_length=1,
        description="the unit of lengths after scaling, of results and of every length that is a plain number: nm, "
        "angstrom, um, a name of your own, or a multiple like '100 nm', with results in nm; where a file has a scale "
        "and no length_unit, its coordinates are nm, and so are results",
    )

    @field_validator("length_unit")
    @classmethod
    def _oneWord(cls, name: str) -> str:
        if len(name.split()) != 1:
            raise ValueError("it must be the name of a unit, or a multiple of one, like 'nm', 'angstrom' or '100 nm'")
        return name.strip()

    @model_validator(mode="after")
    def _oneMesh(self) -> "MeshSection":
        if self.species_field is not None and self.file is None:
            raise ValueError("species_field is given, and there is no file that has it")
        given = [name for name in ("file", "icosphere", "sheet") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                f"{' and '.join(given)} are both given; give one of them"
                if given
                else "file is missing; the mesh to begin with has no default"
            )
        return self


class Targets(Section):
    """What area, volume and area difference are driven to, of each connected surface by itself: a number for all, or a
    list with one for each.
    """

    target_area: TargetArea = Field(None, description="A_0; the mesh's own area by default")
    target_volume: TargetVolume = Field(None, description="V_0; the mesh's own volume by default")
    reduced_volume: ReducedVolume = Field(
        None, description="sets V_0 by 6 sqrt(pi) V_0/A_0^1.5 instead of target_volume"
    )
    target_area_difference: TargetAreaDifference = Field(
        None, description="dA_0; the mesh's own area difference by default"
    )

    @model_validator(mode="after")
    def _oneVolume(self) -> "Targets":
        if self.target_volume is not None and self.reduced_volume is not None:
            raise ValueError("target_volume and reduced_volume are both given; give one of them")
        differences = self.target_area_difference
        if 0 in (differences if isinstance(differences, list) else [differences]):
            raise ValueError(
                "target_area_difference is 0; it must not be, since the energy is that of the ratio dA/dA_0"
            )
        return self

    def targetNames(self) -> list[str]:
        """Return the names of the targets that are given."""
        return [name for name in Targets.model_fields if getattr(self, name) is not None]


class SpeciesChange(Section):
    """What a stage changes of a species."""

    bending_modulus: Energy | None = Field(None, ge=0, description="kappa_B in kT")
    spontaneous_curvature: Curvature | None = Field(None, description="C_0 per length unit")
    gaussian_modulus: Energy | None = Field(None, description="kappa_G in kT")

    @model_validator(mode="after")
    def _change(self) -> "SpeciesChange":
        if not self.model_dump(exclude_none=True):
            raise ValueError(f"has nothing to change; give one of {', '.join(type(self).model_fields)}")
        return self


class Conditions(Targets):
    """What a stage may change: targets, and moduli and the like, from its first step on or along its path."""

    bending_modulus: Energy | None = Field(None, ge=0, description="kappa_B in kT, of a membrane without species")
    gaussian_modulus: Energy | None = Field(None, description="kappa_G in kT, of a membrane without species")
    spontaneous_curvature: Curvature | None = Field(None, description="C_0 per length unit")
    line_tension: LineTensions | None = Field(
        None, description="lambda in kT per length unit, between all species, or a table of pairs"
    )
    pair_energies: PairEnergies | None = Field(None, description="J in kT, a table of pairs, like {'lo, ld' = 0.5}")
    species: dict[str, SpeciesChange] | None = Field(
        None, description="moduli of species by their names, like {lo = {bending_modulus = 30}}"
    )
    area_modulus: Energy | None = Field(None, ge=0, description="kappa_A in kT; 0 releases the area")
    volume_modulus: Energy | None = Field(None, ge=0, description="kappa_V in kT; 0 releases the volume")
    area_difference_modulus: Energy | None = Field(None, ge=0, description="kappa_dA in kT")
    tension: Tension | None = Field(None, description="sigma in kT per squared length unit")
    pressure: Pressure | None = Field(None, description="p in kT per cubed length unit")

    @field_validator("species")
    @classmethod
    def _named(cls, species: dict[str, SpeciesChange] | None) -> dict[str, SpeciesChange] | None:
        if "" in (species or {}):
            raise ValueError("the name of a species is empty; it must not be")
        return species

    def conditions(self) -> dict[str, float]:
        """Return the values that are given of what is no target, by their names; of species and pairs of these, by
        names like "bending_modulus[lo]", "line_tension[ld, lo]" and "pair_energy[ld, lo]".
        """
        tables = {"line_tension": self.line_tension, "pair_energy": self.pair_energies}
        names = (name for name in Conditions.model_fields if name not in {*Targets.model_fields, "species"})
        found = {name: getattr(self, name) for name in names}
        found = {name: value for name, value in found.items() if value is not None and not isinstance(value, dict)}
        for key, table in tables.items():
            found |= {f"{key}[{pair}]": value for pair, value in (table if isinstance(table, dict) else {}).items()}
        for name, change in (self.species or {}).items():
            found |= {f"{key}[{name}]": value for key, value in change.model_dump(exclude_none=True).items()}
        return found


class MembraneSection(Targets):
    """Elasticity.  A term with modulus 0 is not computed."""

    bending_modulus: Energy = Field(20.0, ge=0, description="kappa_B in kT; 20 is typical of a lipid bilayer")
    spontaneous_curvature: Curvature = Field(
        0.0,
        description="C_0 per length unit, in kappa_B/2 times the integral of (2H-C_0)^2: positive where the membrane "
        "would be convex seen from outside, 2/R for a sphere of radius R; of several species it is added to that of "
        "each",
    )
    gaussian_modulus: Energy = Field(
        0.0,
        description="kappa_G in kT, times the integral of the Gaussian curvature: the same everywhere, it adds a "
        "constant of the topology, 4 pi (1-g) kappa_G, and moves nothing",
    )
    line_tension: LineTensions = Field(
        0.0,
        description="lambda in kT per length unit, of the boundaries between species: a number for all, or a table of "
        "pairs, like {'lo, ld' = 2}",
    )
    pair_energies: PairEnergies = Field(
        {},
        description="J in kT of each edge between vertices of two species, or of the same: a table of pairs, like "
        "{'lo, ld' = 0.5}",
    )
    area_modulus: Energy = Field(
        1e6,
        ge=0,
        description="kappa_A in kT; 1e6 lets the area fluctuate by 0.07%; by default "
        "390 for each vertex of the largest surface if that is more; of a "
        "periodic membrane, whose box holds it, 0 by default",
    )
    volume_modulus: Energy = Field(
        1e6,
        ge=0,
        description="kappa_V in kT; 1e6 lets the volume fluctuate by 0.07%; by default 390 for each vertex of the "
        "largest surface if that is more; a periodic membrane has none, and 0",
    )
    area_difference_modulus: Energy = Field(0.0, ge=0, description="kappa_dA in kT; off by default")
    leaflet_separation: Length = Field(
        1.0, gt=0, description="h in dA = 2hM; it cancels from the energy, where only dA/dA_0 counts"
    )
    tension: Tension = Field(
        0.0,
        description="sigma in kT per squared length unit, which adds sigma A to the energy: positive, it shrinks the "
        "surface; a tension of its own wants an area_modulus of 0",
    )
    pressure: Pressure = Field(
        0.0,
        description="p in kT per cubed length unit, inside less outside, which adds -pV to the energy: positive, it "
        "blows the surface up; a pressure of its own wants a volume_modulus of 0",
    )


class SpeciesSection(Section):
    """One of the materials that the membrane is made of, and which vertices it has at the start: a list, a share of
    them at random or in one place, or, of one species, all that are left.
    """

    name: str = Field(min_length=1, description="what the species is called")
    bending_modulus: Energy | None = Field(None, ge=0, description="kappa_B in kT; that of [membrane] by default")
    spontaneous_curvature: Curvature = Field(0.0, description="C_0 per length unit, added to that of [membrane]")
    gaussian_modulus: Energy | None = Field(None, description="kappa_G in kT; that of [membrane] by default")
    chemical_potential: Energy = Field(
        0.0, description="mu in kT, for exchange_proposal = 'mutation': the greater, the more vertices are of it"
    )
    fraction: float | None = Field(
        None, ge=0, le=1, description="the share of all vertices that are of the species at the start"
    )
    region: Literal["random", "cap", "patch", "stripe"] = Field(
        "random",
        description="where they are: anywhere; furthest along the direction; nearest to the point of the surface that "
        "is furthest along it; or nearest to the plane through the middle that is normal to it",
    )
    direction: Annotated[list[float], Field(min_length=3, max_length=3)] = Field(
        [0.0, 0.0, 1.0], description="of a cap, a patch or a stripe"
    )
    vertices: list[Annotated[int, Field(ge=0)]] | None = Field(
        None, description="instead of a fraction: the indices, from 0, of its vertices"
    )

    @field_validator("name")
    @classmethod
    def _plainName(cls, name: str) -> str:
        if "," in name or name != name.strip() or not name.isprintable() or len(name) > 60:
            raise ValueError("it must have at most 60 characters that print, no comma, and no blank at its ends")
        return name

    @model_validator(mode="after")
    def _onePlace(self) -> "SpeciesSection":
        if self.fraction is not None and self.vertices is not None:
            raise ValueError("fraction and vertices are both given; give one of them")
        if self.region != "random":
            if self.fraction is None:
                raise ValueError(f"region is '{self.region}', and there is no fraction; give the share of all vertices")
            if not any(self.direction):
                raise ValueError("direction is [0, 0, 0]; it must not be")
        elif self.direction != type(self).model_fields["direction"].default:
            raise ValueError(
                f"direction is {self.direction}, and has no effect without a region that has one: 'cap', 'patch' or "
                "'stripe'"
            )
        return self

    @property
    def isRest(self) -> bool:
        """Whether it has the vertices that no other species has."""
        return self.fraction is None and self.vertices is None


class TetherSection(Section):
    """Bounds on the length of edges, which keep triangles well shaped while they flow."""

    modulus: Energy | None = Field(
        None,
        ge=0,
        description="kappa_T in kT; by default such that an edge costs 4 kT when it is longer than "
        "max_length by a tenth of the mean edge length: 50 where this is the length_scale, and the exponent 2",
    )
    length_scale: Length | None = Field(
        None,
        gt=0,
        description="l_0, the unit of lengths in the tether's energy, where one modulus multiplies a wall that goes as "
        "(l/l_0)^-r and a spring that goes as (l/l_0)^r; by default the mean edge length, or 1 where modulus is given",
    )
    min_length: Length | None = Field(None, gt=0, description="l_c1; by default 0.83 of the mean edge length")
    max_length: Length | None = Field(None, gt=0, description="l_c0; by default 1.33 of the mean edge length")
    exponent: int = Field(2, ge=1, le=100, description="r; 2 makes the long branch a spring")


class RepulsionSection(Section):
    """Keeps the surface from crossing itself.  Off by default: it needs a neighbor list."""

    modulus: Energy = Field(0.0, ge=0, description="kappa_R in kT")
    onset: Length | None = Field(
        None, gt=0, description="the distance below which vertices repel each other; the tether's min_length by default"
    )
    length_scale: Length | None = Field(
        None, gt=0, description="the unit of lengths in the repulsion's energy, which goes as (r/l_0)^-r; 1 by default"
    )
    exponent: int = Field(2, ge=1, le=100, description="r, as for the tether")
    exclusion_level: Literal[0, 1, 2] = Field(
        1, description="leave out no pair (0), bonded vertices (1), or also those that share a neighbor (2)"
    )


class SamplingSection(Section):
    """Hybrid Monte Carlo with edge flips."""

    steps: int = Field(
        1000,
        ge=1,
        description="number of Monte Carlo steps, each a trajectory or a sweep of flips; stages have steps of their "
        "own",
    )
    temperature: Temperature = Field(
        300.0, gt=0, description="in K; energies in kT are at this temperature, whatever a stage does"
    )
    step_size: StepSize = Field(
        None,
        description="of a leapfrog step, in ps; the default is a rule of thumb for three trajectories in four "
        'accepted, and more than half beyond 2,562 vertices; "auto" finds, '
        "during the burn-in, the one that is accepted as often as target_acceptance says, and keeps it",
    )
    burn_in: int | None = Field(
        None,
        ge=1,
        description='steps at the start of each sampling stage during which an "auto" step size adapts; by default a '
        "fifth of the stage, but no more than 1000, which determine it to a few percent",
    )
    approach: Literal["auto", "none"] = Field(
        "auto",
        description='"auto" leads area, volume and area difference to targets that are more than 5% away by a stage of '
        'its own, since a sudden change crumples a membrane; "none" changes them at once',
    )
    target_acceptance: float = Field(
        0.75,
        gt=0,
        lt=1,
        description='what an "auto" step size, and that of an annealing stage, aim at; long trajectories give '
        "most for their cost near 0.65, and 0.75 is safer where the membrane turns stiffer",
    )
    steps_per_trajectory: int = Field(
        100, ge=1, le=GREATEST_COUNT, description="steps in a trajectory, each of which computes the forces once"
    )
    integrator: Literal["leapfrog", "bcss2", "bcss3"] = Field(
        "leapfrog",
        description="of a trajectory; the splittings of two and three stages (Blanes, Casas and Sanz-Serna, 2014) "
        "have smaller errors for the same cost; step_size remains the time per computation of forces",
    )
    tether_substeps: int = Field(
        1,
        ge=1,
        le=GREATEST_COUNT,
        description="how often the tether acts for each time that everything else does; with more than 1 the "
        "step_size, of everything else, can be longer",
    )
    trajectory_jitter: float = Field(
        0.0,
        ge=0,
        lt=1,
        description="largest fraction by which the number of steps in a trajectory varies at random; 0.2 or more keeps "
        "a mode from returning to where it began in every trajectory, 0 is the plain method",
    )
    momentum_refreshment: float = Field(
        1.0,
        gt=0,
        le=1,
        description="how much of the velocities a trajectory draws anew; with less than 1 motions go on from one "
        'trajectory to the next, which takes an "auto" step_size with a target_acceptance of 0.9; 1 is the plain '
        "method",
    )
    multilevel_weight: MultilevelWeight = Field(
        "auto",
        description="weight of momenta on coarser meshes, with which long waves move nearly as fast as short ones; 0 "
        'for none, 2 for a large membrane; "auto" takes 2 where a surface has 1000 vertices or more and the steps of '
        "no stage need be shorter with it, and 0 elsewhere",
    )
    flip_fraction: float = Field(
        0.3,
        ge=0,
        description="attempts in a sweep, as a fraction of the number of edges; sweeps cost little beside "
        "trajectories, and 0.1 makes the membrane half as fluid",
    )
    flip_probability: float = Field(
        0.5, ge=0, le=1, description="probability that a step is a sweep; 0 gives a membrane that does not flow"
    )
    exchange_probability: float = Field(
        0.0,
        ge=0,
        le=1,
        description="probability that a step is a sweep of exchanges of species; 0 leaves them where they are",
    )
    exchange_fraction: float = Field(
        0.3, ge=0, description="attempts in a sweep of exchanges, as a fraction of the number of edges"
    )
    exchange_proposal: Literal["neighbors", "anywhere", "mutation"] = Field(
        "neighbors",
        description="what exchanges: the two ends of an edge; two vertices wherever they are; or a vertex gets another "
        "species, by the chemical potentials",
    )
    shear_wave_probability: float = Field(
        0.0,
        ge=0,
        le=1,
        description="probability that a step is one of shear waves, which move the longest wavelengths of large "
        "membranes faster than trajectories do; 0 makes none",
    )
    shear_waves_per_step: int = Field(
        50,
        ge=1,
        le=GREATEST_COUNT,
        description="moves in such a step, each of which costs about half as much as a leapfrog step",
    )
    shear_wave_cutoff: float = Field(
        3.0,
        ge=1,
        description="largest wave number, in units of 1/R, for a sphere of radius R with the area A_0; the smallest is "
        "1",
    )
    shear_wave_amplitude: Amplitude = Field(
        "auto",
        description='standard deviation of the amplitude of the longest waves; "auto" adapts it, as a step_size, to an '
        "acceptance of 1/4, where they get furthest",
    )
    mass: Mass = Field(1.0, gt=0, description="of a vertex, in Da; it sets the scale of step_size and no average")
    seed: int | None = Field(
        None, ge=1, le=2**31 - 1, description="of all random numbers; drawn and printed by default"
    )

    @model_validator(mode="after")
    def _probabilities(self) -> "SamplingSection":
        others = {
            name: getattr(self, name)
            for name in ("flip_probability", "exchange_probability", "shear_wave_probability")
            if getattr(self, name) > 0
        }
        if sum(others.values()) > 1:
            named = [f"{name} {'is ' if i == 0 else ''}{value:g}" for i, (name, value) in enumerate(others.items())]
            raise ValueError(f"{' and '.join(named)}; they must not add up to more than 1")
        return self


class SystemSection(Section):
    """What there is beside the membrane: OpenMM's own forces, and vertices that stay where they are."""

    forces: ForceFiles = Field(
        None,
        description="file of OpenMM's XML of a Force, or of a System whose forces are taken, relative to the "
        "configuration's folder; a list for several.  Beads take a script: mh.run(config, setup=...)",
    )
    fixed: list[Annotated[int, Field(ge=0)]] | None = Field(
        None,
        description="indices, from 0, of vertices that stay where they are; their edges flip like all others",
    )
    fixed_box: list[Corner] | None = Field(
        None,
        min_length=2,
        max_length=2,
        description="instead: [[x, y, z], [x, y, z]], the least and the greatest coordinates of a box; the vertices "
        "that are in it at the start stay where they are",
    )

    @model_validator(mode="after")
    def _oneChoice(self) -> "SystemSection":
        if self.fixed is not None and self.fixed_box is not None:
            raise ValueError("fixed and fixed_box are both given; give one of them")
        if self.fixed_box is not None and any(low > high for low, high in zip(*self.fixed_box)):
            raise ValueError(f"fixed_box is {self.fixed_box}; the least coordinates must come first")
        return self


def _platformName(name: Any) -> Any:
    """Return OpenMM's name of a platform for one in other letters, as "cpu"."""
    names = {known.lower(): known for known in ("Reference", "CPU", "CUDA", "OpenCL", "HIP")}
    return names.get(name.lower(), name) if isinstance(name, str) else name


class PlatformSection(Section):
    """Where OpenMM computes."""

    name: Annotated[str, BeforeValidator(_platformName)] = Field(
        "CPU", description="CPU, or Reference for clarity and its last digits"
    )
    threads: int | None = Field(None, ge=1, description="on CPU; all cores by default.  Results do not depend on it")
    precision: Literal["double", "mixed"] = Field(
        "double",
        description='of the forces in trajectories, on CPU; "mixed" computes angles and forces in single precision, '
        "1.5 to 1.7 times as fast, and samples the same distribution",
    )


class OutputSection(Section):
    """What is written.  Every name begins with the prefix."""

    prefix: FileName | None = Field(
        None,
        description="relative to the working folder; the configuration file's name without suffix by default",
    )
    trajectory_interval: int = Field(100, ge=1, description="steps between frames of PREFIX.dcd and PREFIX.vtkhdf")
    mesh_trajectory: bool = Field(
        True,
        description="write PREFIX.vtkhdf, which has each frame's triangles and curvature, for ParaView and pyvista",
    )
    psf: bool | None = Field(
        None,
        description="write PREFIX.psf, the atoms and bonds that VMD and mdtraj want beside PREFIX.dcd; by default for "
        "no more than 200,000 vertices, since it is as large as a dozen frames",
    )
    observables_interval: int = Field(10, ge=1, description="steps between rows of PREFIX.csv")
    checkpoint_interval: int | None = Field(
        None, ge=1, description="steps between checkpoints; by default time alone decides"
    )
    checkpoint_seconds: float = Field(
        300.0,
        gt=0,
        description="longest time between checkpoints; a kill costs so much, and a checkpoint a few milliseconds for "
        "thousands of vertices.  When they are written changes no result",
    )
    mesh_format: Literal["ply", "stl", "obj", "off", "vtu", "vtk", "msh"] = Field(
        "ply", description="of the final mesh; PLY holds double precision and opens everywhere"
    )
    overwrite: bool = Field(False, description="replace the files of an earlier run")


def checkSpecies(
    species: list[SpeciesSection], mesh: MeshSection, membrane: MembraneSection, sampling: SamplingSection
) -> None:
    """Raise a ValueError if species do not go with each other, or with what names them."""
    names = [each.name for each in species]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"there are {names.count(name)} species called '{name}'; each must have a name of its own")
    pairs = {
        "line_tension": membrane.line_tension if isinstance(membrane.line_tension, dict) else {},
        "pair_energies": membrane.pair_energies,
    }
    for key, values in pairs.items():
        for pair in values:
            for name in pair.split(", "):
                if name not in names:
                    known = f"the species are {', '.join(names)}" if names else "there are no [[species]]"
                    raise ValueError(
                        f"[membrane] {key} has the pair '{pair}', and no species is called '{name}'; {known}"
                    )
            if key == "line_tension" and len(set(pair.split(", "))) == 1:
                raise ValueError(f"[membrane] line_tension has the pair '{pair}'; it must be of two different species")
    if not species and mesh.species_field is not None:
        raise ValueError("[mesh] species_field has no effect without [[species]], whose numbers it has")
    _checkExchanges(species, sampling)
    if mesh.species_field is None:
        return
    placed = [each.name for each in species if not each.isRest]
    if placed:
        raise ValueError(
            f"[mesh] species_field says where species are, and the species {placed[0]} has a fraction or vertices of "
            "its own; give one of them"
        )


def _checkExchanges(species: list[SpeciesSection], sampling: SamplingSection) -> None:
    """Raise a ValueError if settings of exchanges have no effect."""
    names = ("exchange_probability", "exchange_fraction", "exchange_proposal")
    for name in names:
        if len(species) < 2 and getattr(sampling, name) != SamplingSection.model_fields[name].default:
            why = "with one of [[species]]; it takes two" if species else "without [[species]], which exchange places"
            raise ValueError(f"[sampling] {name} has no effect {why}")
        if sampling.exchange_probability == 0 and getattr(sampling, name) != SamplingSection.model_fields[name].default:
            raise ValueError(f"[sampling] {name} has no effect, since exchange_probability is 0; give it, too")
    mutates = sampling.exchange_probability > 0 and sampling.exchange_proposal == "mutation"
    for each in species:
        if each.chemical_potential != 0 and not mutates:
            raise ValueError(
                f"the chemical_potential of the species {each.name} has no effect without mutations; give "
                "exchange_proposal = 'mutation' in [sampling], and an exchange_probability"
            )


def checkMaterial(species: list[SpeciesSection], membrane: MembraneSection, later: Sequence[str]) -> None:
    """Raise a ValueError if moduli of species or of a membrane have no effect, also with those that stages give."""
    if membrane.line_tension and len(species) < 2:
        why = "with one of [[species]]; it takes two" if species else "without [[species]], whose boundaries it is of"
        raise ValueError(f"[membrane] line_tension has no effect {why}")
    if any(membrane.pair_energies.values()) and len(species) == 1:
        raise ValueError("[membrane] pair_energies has no effect with one of [[species]], whose edges are all alike")
    if membrane.gaussian_modulus != 0 and species and all(each.gaussian_modulus is not None for each in species):
        raise ValueError("[membrane] gaussian_modulus has no effect, since each of [[species]] has its own")
    moduli = [membrane.bending_modulus if each.bending_modulus is None else each.bending_modulus for each in species]
    for each, modulus in zip(species, moduli):
        if each.spontaneous_curvature != 0 and modulus == 0 and f"bending_modulus[{each.name}]" not in later:
            raise ValueError(
                f"the spontaneous_curvature of the species {each.name} has no effect, since its bending_modulus is 0"
            )
    bends = any(moduli or [membrane.bending_modulus]) or any(name.startswith("bending_modulus") for name in later)
    if membrane.spontaneous_curvature != 0 and not bends:
        raise ValueError("[membrane] spontaneous_curvature has no effect, since the bending_modulus is 0")


def checkShares(species: Sequence[SpeciesSection]) -> None:
    """Raise a ValueError if species have no places that add up to all vertices."""
    rest, total = [each.name for each in species if each.isRest], sum(each.fraction or 0 for each in species)
    if len(rest) > 1:
        raise ValueError(
            f"the species {', '.join(rest)} have neither fraction nor vertices; one of them has what is left, and the "
            "others need one"
        )
    if total > 1 + 1e-9:
        raise ValueError(f"the fractions of the species add up to {total:g}; they must not add up to more than 1")
    if not rest and all(each.fraction is not None for each in species) and total < 1 - 1e-9:
        raise ValueError(
            f"the fractions of the species add up to {total:g}; they must add up to 1, or one species, which has what "
            "is left, must have none"
        )
