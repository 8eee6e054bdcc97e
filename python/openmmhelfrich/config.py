"""The configuration of a run: a TOML file, read and validated before anything else happens.

Lengths are in the mesh's ``length_unit``, areas and volumes in its powers, energies in kT at the run's temperature, temperatures in K, masses
in Da and times in ps.  The membrane's energy has no length scale of its own, so a unit of length is a label: OpenMM's nm stands for it.
"""
import difflib
import sys
from pathlib import Path
from typing import Literal, Optional

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


class Section(BaseModel):
    """A table of the file.  Unknown keys, numbers in quotes, NaN and infinity are errors."""
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class MeshSection(Section):
    """The membrane to begin with."""
    file: str = Field(min_length=1, description="mesh file (STL, PLY, OBJ, OFF, VTU, GMSH ...), relative to the configuration's folder")
    scale: float = Field(1.0, gt=0, description="factor on the file's coordinates, to bring the mean edge length between 0.01 and 10, where the "
                         "power laws of tether and repulsion are meant to be used; 1 leaves them as they are")
    length_unit: str = Field("nm", min_length=1, pattern=r"^\S+$", description="what one unit of length is called after scaling; it labels results and changes no number")


class MembraneSection(Section):
    """Elasticity.  A term with modulus 0 is not computed."""
    bending_modulus: float = Field(20.0, ge=0, description="kappa_B in kT; 20 is typical of a lipid bilayer")
    area_modulus: float = Field(1e6, ge=0, description="kappa_A in kT; 1e6 lets the area fluctuate by 0.07%")
    volume_modulus: float = Field(1e6, ge=0, description="kappa_V in kT; 1e6 lets the volume fluctuate by 0.07%")
    area_difference_modulus: float = Field(0.0, ge=0, description="kappa_dA in kT; off by default, which is the spontaneous-curvature-free model")
    target_area: Optional[float] = Field(None, gt=0, description="A_0; the mesh's own area by default")
    target_volume: Optional[float] = Field(None, gt=0, description="V_0; the mesh's own volume by default")
    reduced_volume: Optional[float] = Field(None, gt=0, le=1, description="sets V_0 by 6 sqrt(pi) V_0/A_0^1.5 instead of target_volume")
    target_area_difference: Optional[float] = Field(None, description="dA_0; the mesh's own area difference by default")
    leaflet_separation: float = Field(1.0, gt=0, description="h in dA = 2hM; it cancels from the energy, where only dA/dA_0 counts")

    @model_validator(mode="after")
    def _oneVolume(self):
        if self.target_volume is not None and self.reduced_volume is not None:
            raise ValueError("target_volume and reduced_volume are both given; give one of them")
        if self.target_area_difference == 0:
            raise ValueError("target_area_difference is 0; it must not be, since the energy is that of the ratio dA/dA_0")
        return self


class TetherSection(Section):
    """Bounds on the length of edges, which keep triangles well shaped while they flow."""
    modulus: Optional[float] = Field(None, ge=0, description="kappa_T in kT; by default such that an edge costs 20 kT when it is longer than "
                                     "max_length by a tenth of the mean edge length")
    min_length: Optional[float] = Field(None, gt=0, description="l_c1; by default 0.75 of the mean edge length, or 0.95 of the shortest edge if that is less")
    max_length: Optional[float] = Field(None, gt=0, description="l_c0; by default 1.4 of the mean edge length, or 1.05 of the longest edge if that is more")
    exponent: int = Field(2, ge=1, description="r; 2 makes the long branch a spring")


class RepulsionSection(Section):
    """Keeps the surface from crossing itself.  Off by default: it needs a neighbour list."""
    modulus: float = Field(0.0, ge=0, description="kappa_R in kT")
    onset: Optional[float] = Field(None, gt=0, description="the distance below which vertices repel each other; the tether's min_length by default")
    exponent: int = Field(2, ge=1, description="r, as for the tether")
    exclusion_level: Literal[0, 1, 2] = Field(1, description="leave out no pair (0), bonded vertices (1), or also those that share a neighbour (2)")


class SamplingSection(Section):
    """Hybrid Monte Carlo with edge flips."""
    steps: int = Field(1000, ge=1, description="number of Monte Carlo steps, each a trajectory or a sweep of flips")
    temperature: float = Field(300.0, gt=0, description="in K")
    step_size: Optional[float] = Field(None, gt=0, description="of a leapfrog step, in ps; the default is a rule of thumb: see defaultStepSize()")
    steps_per_trajectory: int = Field(100, ge=1, description="leapfrog steps in a trajectory")
    flip_fraction: float = Field(0.1, ge=0, description="attempts in a sweep, as a fraction of the number of edges")
    flip_probability: float = Field(0.5, ge=0, le=1, description="probability that a step is a sweep; 0 gives a membrane that does not flow")
    mass: float = Field(1.0, gt=0, description="of a vertex, in Da; it sets the scale of step_size and no average")
    seed: Optional[int] = Field(None, ge=1, le=2**31-1, description="of all random numbers; drawn and printed by default")


class PlatformSection(Section):
    """Where OpenMM computes."""
    name: str = Field("CPU", description="CPU, or Reference for clarity")
    threads: Optional[int] = Field(None, ge=1, description="on CPU; all cores by default.  Results do not depend on it")


class OutputSection(Section):
    """What is written.  Every name begins with the prefix."""
    prefix: Optional[str] = Field(None, min_length=1, description="relative to the working folder; the configuration file's name without suffix by default")
    trajectory_interval: int = Field(100, ge=1, description="steps between frames of PREFIX.dcd")
    observables_interval: int = Field(10, ge=1, description="steps between rows of PREFIX.csv")
    mesh_format: Literal["ply", "stl", "obj", "off", "vtu", "vtk", "msh"] = Field("ply", description="of the final mesh; PLY holds double precision and opens everywhere")
    overwrite: bool = Field(False, description="replace the files of an earlier run")


class Config(Section):
    """A whole configuration."""
    mesh: MeshSection
    membrane: MembraneSection = MembraneSection()
    tether: TetherSection = TetherSection()
    repulsion: RepulsionSection = RepulsionSection()
    sampling: SamplingSection = SamplingSection()
    platform: PlatformSection = PlatformSection()
    output: OutputSection = OutputSection()


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
    if not path.exists():
        raise FileNotFoundError(f"there is no configuration file {path}")
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not TOML: {error}") from None
    config = parseConfig(data, str(path))
    config.mesh.file = str(path.parent/config.mesh.file)
    if config.output.prefix is None:
        config.output.prefix = path.stem
    return config


def parseConfig(data, source="configuration"):
    """Return the Config that a nested dict describes, or raise a ValueError with a sentence for each mistake."""
    try:
        return Config.model_validate(data)
    except ValidationError as error:
        raise ValueError("\n".join(f"{source}: {_explain(mistake)}" for mistake in error.errors())) from None


def sections():
    """Return the sections of a configuration by name, in order."""
    return {name: field.annotation for name, field in Config.model_fields.items()}


def _explain(mistake):
    """Return a sentence for one of pydantic's errors."""
    place, kind = mistake["loc"], mistake["type"]
    if kind == "extra_forbidden":
        return _explainUnknown(*place)
    name = f"[{place[0]}] {' '.join(map(str, place[1:]))}".strip() if place else "the file"
    if kind == "missing":
        return f"{name} is missing{'; the mesh to begin with has no default' if place[0] == 'mesh' else ''}"
    message = mistake["msg"].removeprefix("Value error, ").replace("Input should be", "it must be").replace("a valid ", "a ")
    if kind == "value_error":
        return f"{name}: {message}"
    if kind == "model_type":
        return f"{name} is {mistake['input']!r}; it must be a table of keys"
    return f"{name} is {mistake['input']!r}; {message}"


def _explainUnknown(section, key=None):
    if key is None:
        return f"there is no section or key '{section}'{_nearest(section, sections())}"
    known = sections()[section].model_fields
    homes = [name for name, model in sections().items() if key in model.model_fields]
    if homes:
        return f"[{section}] has no key '{key}'; it belongs in [{homes[0]}]"
    return f"[{section}] has no key '{key}'{_nearest(key, known)}"


def _nearest(word, known):
    match = difflib.get_close_matches(word.lower(), known, n=1)
    return f"; did you mean '{match[0]}'?" if match else f"; it has {', '.join(known)}"
