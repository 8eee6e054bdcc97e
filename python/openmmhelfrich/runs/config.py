"""The configuration of a run: a TOML file, read and validated before anything else happens.

Lengths are in the mesh's ``length_unit``, areas and volumes in its powers, energies in kT at the run's temperature, temperatures in K, masses
in Da and times in ps.  The membrane's energy has no length scale of its own, so a unit of length is a label: OpenMM's nm stands for it.
A string with a unit, like "80 kJ/mol" or "0.5 um", may stand for a number; it is converted while the file is read.
"""

import difflib
import math
import sys
from pathlib import Path
from typing import Annotated, Any, Dict, List, Literal, Optional, Union

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainValidator, ValidationError, model_validator

from ..units import Scales, lengthUnit, plainNumber
from ..sampling.reporters import thermalEnergy

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


def _number(kind):
    """Return the type of a number that may have a unit."""
    return Annotated[
        float,
        BeforeValidator(lambda value, info: plainNumber(value, kind, info.context or Scales(thermalEnergy(300.0)))),
    ]


def _numberOrAuto(kind, unitName):
    """Return the type of a positive number that may have a unit, or "auto"."""

    def validate(value, info):
        if value is None or value == "auto":
            return value
        number = plainNumber(value, kind, info.context)
        if (
            isinstance(number, bool)
            or not isinstance(number, (int, float))
            or not (math.isfinite(number) and number > 0)
        ):
            raise ValueError(f"it must be a positive number, in {unitName}, or 'auto'")
        return float(number)

    return Annotated[Any, PlainValidator(validate)]


Energy, Length, Area, Volume, Time, Mass, Temperature = map(
    _number, ("energy", "length", "area", "volume", "time", "mass", "temperature")
)
StepSize, Amplitude = _numberOrAuto("time", "ps"), _numberOrAuto("length", "length units")


class Section(BaseModel):
    """A table of the file.  Unknown keys, NaN and infinity are errors, and so are numbers in quotes that have no unit."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class MeshSection(Section):
    """The membrane to begin with: a file, or a sphere."""

    file: Optional[str] = Field(
        None,
        min_length=1,
        description="mesh file (STL, PLY, OBJ, OFF, VTU, GMSH ...), relative to the configuration's folder",
    )
    icosphere: Optional[int] = Field(
        None,
        ge=0,
        le=8,
        description="instead of a file: a sphere of radius 1, an icosahedron subdivided so often; 3 gives "
        "642 vertices, 4 gives 2562",
    )
    scale: float = Field(
        1.0,
        gt=0,
        description="factor on the coordinates, to bring the mean edge length between 0.01 and 10, where the "
        "power laws of tether and repulsion are meant to be used; 1 leaves them as they are",
    )
    length_unit: str = Field(
        "nm",
        min_length=1,
        pattern=r"^\S+$",
        description="what one unit of length is called after scaling; it labels results and is the "
        "unit of every length that is a plain number",
    )

    @model_validator(mode="after")
    def _oneMesh(self):
        if (self.file is None) == (self.icosphere is None):
            raise ValueError(
                "file is missing; the mesh to begin with has no default"
                if self.file is None
                else "file and icosphere are both given; give one of them"
            )
        return self


class Targets(Section):
    """What area, volume and area difference are driven to."""

    target_area: Optional[Area] = Field(None, gt=0, description="A_0; the mesh's own area by default")
    target_volume: Optional[Volume] = Field(None, gt=0, description="V_0; the mesh's own volume by default")
    reduced_volume: Optional[float] = Field(
        None, gt=0, le=1, description="sets V_0 by 6 sqrt(pi) V_0/A_0^1.5 instead of target_volume"
    )
    target_area_difference: Optional[Area] = Field(None, description="dA_0; the mesh's own area difference by default")

    @model_validator(mode="after")
    def _oneVolume(self):
        if self.target_volume is not None and self.reduced_volume is not None:
            raise ValueError("target_volume and reduced_volume are both given; give one of them")
        if self.target_area_difference == 0:
            raise ValueError(
                "target_area_difference is 0; it must not be, since the energy is that of the ratio dA/dA_0"
            )
        return self

    def targetNames(self):
        """Return the names of the targets that are given."""
        return [name for name in Targets.model_fields if getattr(self, name) is not None]


class MembraneSection(Targets):
    """Elasticity.  A term with modulus 0 is not computed."""

    bending_modulus: Energy = Field(20.0, ge=0, description="kappa_B in kT; 20 is typical of a lipid bilayer")
    area_modulus: Energy = Field(1e6, ge=0, description="kappa_A in kT; 1e6 lets the area fluctuate by 0.07%")
    volume_modulus: Energy = Field(1e6, ge=0, description="kappa_V in kT; 1e6 lets the volume fluctuate by 0.07%")
    area_difference_modulus: Energy = Field(
        0.0, ge=0, description="kappa_dA in kT; off by default, which is the spontaneous-curvature-free model"
    )
    leaflet_separation: Length = Field(
        1.0, gt=0, description="h in dA = 2hM; it cancels from the energy, where only dA/dA_0 counts"
    )


class TetherSection(Section):
    """Bounds on the length of edges, which keep triangles well shaped while they flow."""

    modulus: Optional[Energy] = Field(
        None,
        ge=0,
        description="kappa_T in kT; by default such that an edge costs 4 kT when it is longer than "
        "max_length by a tenth of the mean edge length: 50 where this is the length_scale, and the exponent 2",
    )
    length_scale: Optional[Length] = Field(
        None,
        gt=0,
        description="l_0, the unit of lengths in the tether's energy, where one modulus multiplies a wall that goes as "
        "(l/l_0)^-r and a spring that goes as (l/l_0)^r; by default the mean edge length, or 1 where modulus is given",
    )
    min_length: Optional[Length] = Field(None, gt=0, description="l_c1; by default 0.83 of the mean edge length")
    max_length: Optional[Length] = Field(None, gt=0, description="l_c0; by default 1.33 of the mean edge length")
    exponent: int = Field(2, ge=1, le=100, description="r; 2 makes the long branch a spring")


class RepulsionSection(Section):
    """Keeps the surface from crossing itself.  Off by default: it needs a neighbour list."""

    modulus: Energy = Field(0.0, ge=0, description="kappa_R in kT")
    onset: Optional[Length] = Field(
        None, gt=0, description="the distance below which vertices repel each other; the tether's min_length by default"
    )
    exponent: int = Field(2, ge=1, le=100, description="r, as for the tether")
    exclusion_level: Literal[0, 1, 2] = Field(
        1, description="leave out no pair (0), bonded vertices (1), or also those that share a neighbour (2)"
    )


class SamplingSection(Section):
    """Hybrid Monte Carlo with edge flips."""

    steps: int = Field(
        1000,
        ge=1,
        description="number of Monte Carlo steps, each a trajectory or a sweep of flips; stages have steps of their own",
    )
    temperature: Temperature = Field(
        300.0, gt=0, description="in K; energies in kT are at this temperature, whatever a stage does"
    )
    step_size: StepSize = Field(
        None,
        description='of a leapfrog step, in ps; the default is a rule of thumb for three trajectories in four accepted; "auto" finds, '
        "during the burn-in, the one that is accepted as often as target_acceptance says, and keeps it",
    )
    burn_in: Optional[int] = Field(
        None,
        ge=1,
        description='steps at the start of each sampling stage during which an "auto" step size adapts; by default a fifth of the '
        "stage, but no more than 1000, which determine it to a few percent",
    )
    target_acceptance: float = Field(
        0.75,
        gt=0,
        lt=1,
        description='what an "auto" step size, and that of an annealing stage, aim at; long trajectories give '
        "most for their cost near 0.65, and 0.75 is safer where the membrane turns stiffer",
    )
    steps_per_trajectory: int = Field(
        100, ge=1, description="steps in a trajectory, each of which computes the forces once"
    )
    integrator: Literal["leapfrog", "bcss2", "bcss3"] = Field(
        "leapfrog",
        description="of a trajectory; the splittings of two and three stages (Blanes, Casas and Sanz-Serna, 2014) "
        "have smaller errors for the same cost; step_size remains the time per computation of forces",
    )
    tether_substeps: int = Field(
        1,
        ge=1,
        description="how often the tether acts for each time that everything else does; with more than 1 the step_size, of everything else, "
        "can be longer",
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
        description="how much of the velocities a trajectory draws anew; with less than 1 motions go on from one trajectory to the next, which "
        "takes a target_acceptance of 0.9; 1 is the plain method",
    )
    flip_fraction: float = Field(
        0.3,
        ge=0,
        description="attempts in a sweep, as a fraction of the number of edges; sweeps cost little beside trajectories, and 0.1 "
        "makes the membrane half as fluid",
    )
    flip_probability: float = Field(
        0.5, ge=0, le=1, description="probability that a step is a sweep; 0 gives a membrane that does not flow"
    )
    shear_wave_probability: float = Field(
        0.0,
        ge=0,
        le=1,
        description="probability that a step is one of shear waves, which move the longest wavelengths of large "
        "membranes faster than trajectories do; 0 makes none",
    )
    shear_waves_per_step: int = Field(
        50, ge=1, description="moves in such a step, each of which costs about half as much as a leapfrog step"
    )
    shear_wave_cutoff: float = Field(
        3.0,
        ge=1,
        description="largest wave number, in units of 1/R, for a sphere of radius R with the area A_0; the smallest is 1",
    )
    shear_wave_amplitude: Amplitude = Field(
        "auto",
        description='standard deviation of the amplitude of the longest waves; "auto" adapts it, as a step_size, to an '
        "acceptance of 1/4, where they get furthest",
    )
    mass: Mass = Field(1.0, gt=0, description="of a vertex, in Da; it sets the scale of step_size and no average")
    seed: Optional[int] = Field(
        None, ge=1, le=2**31 - 1, description="of all random numbers; drawn and printed by default"
    )

    @model_validator(mode="after")
    def _probabilities(self):
        if self.flip_probability + self.shear_wave_probability > 1:
            raise ValueError(
                f"flip_probability is {self.flip_probability:g} and shear_wave_probability {self.shear_wave_probability:g}; "
                "they must not add up to more than 1"
            )
        return self


class PlatformSection(Section):
    """Where OpenMM computes."""

    name: str = Field("CPU", description="CPU, or Reference for clarity and its last digits")
    threads: Optional[int] = Field(None, ge=1, description="on CPU; all cores by default.  Results do not depend on it")
    precision: Literal["double", "mixed"] = Field(
        "double",
        description='of the forces in trajectories, on CPU; "mixed" computes angles and forces in single precision, '
        "1.5 to 1.7 times as fast, and samples the same distribution",
    )


class OutputSection(Section):
    """What is written.  Every name begins with the prefix."""

    prefix: Optional[str] = Field(
        None,
        min_length=1,
        description="relative to the working folder; the configuration file's name without suffix by default",
    )
    trajectory_interval: int = Field(100, ge=1, description="steps between frames of PREFIX.dcd and PREFIX.vtkhdf")
    mesh_trajectory: bool = Field(
        True,
        description="write PREFIX.vtkhdf, which has each frame's triangles and curvature, for ParaView and pyvista",
    )
    observables_interval: int = Field(10, ge=1, description="steps between rows of PREFIX.csv")
    checkpoint_interval: Optional[int] = Field(
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


class Stage(Targets):
    """A part of a run.  Targets that it gives stay for the stages that follow."""

    name: Optional[str] = Field(None, min_length=1, description="what it is called while it runs; its kind by default")

    @property
    def title(self):
        """What to call the stage."""
        return self.name or self.kind


class MinimizeStage(Stage):
    """Finds a minimum of the energy near by, for its targets: L-BFGS takes turns with flips at zero temperature.  It counts as one step."""

    kind: Literal["minimize"] = Field(description="which kind of stage")
    fluid: bool = Field(
        True,
        description="flip edges where this lowers the energy, and soften penalties that are far from their targets for a while; false keeps "
        "the triangles as they are",
    )
    max_iterations: int = Field(
        10000,
        ge=1,
        description="of L-BFGS, at which to stop; to deflate a sphere of 2562 vertices to a reduced volume of 0.8 took "
        "50000",
    )
    tolerance: Optional[float] = Field(
        None,
        gt=0,
        description="root mean square of the forces at which to stop, in kT per unit of length; by default kappa_B l/(4A), "
        "with the mean edge length l and the area A, below which long waves hardly move",
    )

    @property
    def totalSteps(self):
        return 1


class SampleStage(Stage):
    """Samples at a temperature; the targets that it gives hold from its first step."""

    kind: Literal["sample"] = Field(description="which kind of stage")
    steps: int = Field(1000, ge=1, description="number of Monte Carlo steps")
    temperature: Optional[Temperature] = Field(None, gt=0, description="in K; that of [sampling] by default")
    step_size: StepSize = Field(None, description='in ps, or "auto"; that of [sampling] by default')

    @property
    def totalSteps(self):
        return self.steps


class AnnealStage(Stage):
    """Cools: T(n) = max(T_0 exp(-rate (n-n_0)), T_min) at the stage's step n, for trajectories and flips alike; the step size follows."""

    kind: Literal["anneal"] = Field(description="which kind of stage")
    steps: int = Field(1000, ge=1, description="number of Monte Carlo steps")
    start_temperature: Optional[Temperature] = Field(None, gt=0, description="T_0 in K; that of [sampling] by default")
    end_temperature: Optional[Temperature] = Field(None, gt=0, description="T_min in K; needed where there is no table")
    rate: Optional[float] = Field(
        None, ge=0, description="lambda, per step; by default such that T_min is reached with the last step"
    )
    cooling_start: int = Field(0, ge=0, description="n_0, the stage's step at which cooling begins")
    table: Optional[List[List[Temperature]]] = Field(
        None, min_length=1, description="instead: pairs [step, temperature in K], between which T is linear"
    )

    @model_validator(mode="after")
    def _schedule(self):
        exponential = [
            name for name in ("start_temperature", "end_temperature", "rate") if getattr(self, name) is not None
        ]
        if self.table is None:
            if self.end_temperature is None:
                raise ValueError("end_temperature is missing; give it or a table of temperatures")
            if self.cooling_start >= self.steps:
                raise ValueError(
                    f"cooling_start is {self.cooling_start}; it must be less than the number of steps, {self.steps}"
                )
        elif exponential:
            raise ValueError(f"table and {exponential[0]} are both given; give one of them")
        else:
            _checkTable(self.table)
        return self

    @property
    def totalSteps(self):
        return self.steps


class ContinueStage(Stage):
    """Goes to its targets along eta(lambda) = lambda eta_1 + (1-lambda) eta_0, from those at its start, window by window."""

    kind: Literal["continue"] = Field(description="which kind of stage")
    windows: int = Field(10, ge=1, description="steps of lambda from 0 to 1, so that there are windows+1 values")
    equilibration: int = Field(
        100, ge=0, description="Monte Carlo steps after each change of lambda, which the averages leave out"
    )
    steps: int = Field(100, ge=1, description="Monte Carlo steps over which each window is averaged")
    there_and_back: bool = Field(False, description="go back to lambda = 0 by the same windows, to see hysteresis")
    path: Dict[str, List[float]] = Field(
        {}, description="a lambda of its own for a target: a value for each of the windows+1 points, by name"
    )
    temperature: Optional[Temperature] = Field(None, gt=0, description="in K; that of [sampling] by default")

    @model_validator(mode="after")
    def _paths(self):
        if not self.targetNames():
            raise ValueError(f"has no target to go to; give one of {', '.join(Targets.model_fields)}")
        for name, values in self.path.items():
            if name not in self.targetNames():
                raise ValueError(
                    f"path has '{name}'; it must be a target that the stage gives: {', '.join(self.targetNames())}"
                )
            if len(values) != self.windows + 1:
                raise ValueError(
                    f"path of {name} has {len(values)} values; windows = {self.windows} asks for {self.windows + 1}"
                )
        return self

    @property
    def totalSteps(self):
        return (self.equilibration + self.steps) * (self.windows + 1 + (self.windows if self.there_and_back else 0))


STAGES = {"minimize": MinimizeStage, "sample": SampleStage, "anneal": AnnealStage, "continue": ContinueStage}


class Config(Section):
    """A whole configuration."""

    mesh: MeshSection
    membrane: MembraneSection = MembraneSection()
    tether: TetherSection = TetherSection()
    repulsion: RepulsionSection = RepulsionSection()
    sampling: SamplingSection = SamplingSection()
    platform: PlatformSection = PlatformSection()
    output: OutputSection = OutputSection()
    stages: List[
        Annotated[Union[MinimizeStage, SampleStage, AnnealStage, ContinueStage], Field(discriminator="kind")]
    ] = []


def stagesOf(config):
    """Return the stages of a Config: those it lists, or one that samples.

    Raises a ValueError if [sampling] has steps that no stage would make.
    """
    if not config.stages:
        return [SampleStage(kind="sample", steps=config.sampling.steps)]
    if "steps" in config.sampling.model_fields_set:
        raise ValueError("[sampling] steps is given, and stages too; stages have steps of their own")
    return config.stages


def readConfig(file):
    """Read and validate a configuration file.

    Returns a Config whose mesh file and output prefix are paths that can be opened from the working folder.

    Raises
    ------
    FileNotFoundError
        if there is no such file
    ValueError
        if it is not TOML, or has an unknown key or a value out of range; the message names section, key and what is allowed
    """
    path = Path(file)
    config = parseConfig(readTOML(path), str(path))
    if config.mesh.file is not None:
        config.mesh.file = str(path.parent / config.mesh.file)
    if config.output.prefix is None:
        config.output.prefix = path.stem
    return config


def readTOML(file):
    """Return the nested dict of a configuration file, or raise a FileNotFoundError or ValueError that names the file."""
    path = Path(file)
    if not path.exists():
        raise FileNotFoundError(f"there is no configuration file {path}")
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"{path} is not TOML: {error}") from None


def parseConfig(data, source="configuration"):
    """Return the Config that a nested dict describes, or raise a ValueError with a sentence for each mistake."""
    try:
        return Config.model_validate(data, context=_scales(data))
    except ValidationError as error:
        raise ValueError("\n".join(f"{source}: {_explain(mistake)}" for mistake in error.errors())) from None


def sections():
    """Return the sections of a configuration by name, in order; stages are none of them."""
    return {name: field.annotation for name, field in Config.model_fields.items() if name != "stages"}


def _scales(data):
    """Return the units of the plain numbers of a file, as far as they can be told before it is validated."""
    try:
        kT = thermalEnergy(plainNumber(data["sampling"]["temperature"], "temperature", None))
    except (KeyError, TypeError, ValueError, AttributeError):
        kT = thermalEnergy(SamplingSection.model_fields["temperature"].default)
    try:
        name = data["mesh"].get("length_unit", "nm")
        return Scales(kT, lengthUnit(name), name)
    except (KeyError, TypeError, AttributeError):
        return Scales(kT)


def _checkTable(table):
    for i, row in enumerate(table):
        if len(row) != 2:
            raise ValueError(f"table has the row {row}; each must be [step, temperature]")
        if row[1] <= 0:
            raise ValueError(f"table has the temperature {row[1]:g} K at step {row[0]:g}; it must be positive")
        if i > 0 and row[0] <= table[i - 1][0]:
            raise ValueError(f"table has step {row[0]:g} after step {table[i - 1][0]:g}; steps must ascend")


def _explain(mistake):
    """Return a sentence for one of pydantic's errors."""
    place, kind = mistake["loc"], mistake["type"]
    if kind == "extra_forbidden":
        return _explainUnknown(place)
    name = _placeName(place)
    if kind == "missing":
        return f"{name} is missing{'; the mesh to begin with has no default' if place[0] == 'mesh' else ''}"
    message = requirement(mistake)
    if kind == "union_tag_not_found":
        return f"{name} has no kind; it must be one of {', '.join(STAGES)}"
    if kind == "union_tag_invalid":
        return f"{name} has the kind {mistake['ctx']['tag']!r}{nearest(mistake['ctx']['tag'], STAGES, 'it must be one of')}"
    if kind == "value_error" and isinstance(mistake["input"], dict):
        return f"{name} {message}"  # a key of this table
    if kind == "model_type":
        return f"{name} is {mistake['input']!r}; it must be a table of keys"
    return f"{name} is {mistake['input']!r}; {message}"


def requirement(mistake):
    """Return what one of pydantic's errors says must be."""
    message = mistake["msg"].removeprefix("Value error, ")
    return (
        message.replace("Input should be", "it must be")
        .replace("a valid integer", "a whole number")
        .replace("a valid ", "a ")
    )


def _placeName(place):
    """Return where a mistake is: "[sampling] steps" or "stage 2 (anneal) rate"."""
    if not place:
        return "the file"
    if place[0] == "stages":
        kind = f" ({place[2]})" if len(place) > 2 else ""
        return " ".join([f"stage {place[1] + 1}{kind}" if len(place) > 1 else "stages", *map(str, place[3:])])
    return f"[{place[0]}] {' '.join(map(str, place[1:]))}".strip()


def _explainUnknown(place):
    *home, key = place
    if not home:
        return f"there is no section or key '{key}'{nearest(key, Config.model_fields)}"
    known = (STAGES[home[2]] if home[0] == "stages" else sections()[home[0]]).model_fields
    homes = [name for name, model in sections().items() if key in model.model_fields]
    where = f"{_placeName(home)} has no key '{key}'"
    return f"{where}; it belongs in [{homes[0]}]" if homes else where + nearest(key, known)


def nearest(word, known, otherwise="it has"):
    """Return the end of a sentence about an unknown word: the known one that it resembles, or all of them."""
    match = difflib.get_close_matches(str(word).lower(), known, n=1)
    return f"; did you mean '{match[0]}'?" if match else f"; {otherwise} {', '.join(known)}"
