"""A small study in Python: find the step size, deflate a vesicle and inflate it again, then cool it.

Prints the averages of each window.
"""

import sys

from openmm import unit

import openmmhelfrich as mh

subdivisions, steps = map(int, sys.argv[1:]) if len(sys.argv) > 1 else (3, 100)
temperature = 300 * unit.kelvin
kT = temperature * unit.MOLAR_GAS_CONSTANT_R

# The tether, the step size and all else that is not said here are as in a configuration.
scene = mh.Scene.of(
    {"membrane": {"reduced_volume": 0.95}, "sampling": {"temperature": temperature, "seed": 1}},
    mh.Mesh.icosphere(subdivisions),
)
force = scene.createForce()
simulation = scene.createSimulation(force)

adapted = mh.adaptStepSize(simulation, 2 * steps)
print(f"step size {adapted.stepSize:.3g} ps, accepted {adapted.acceptance:.0%}")

path = mh.continueTo(
    simulation,
    force,
    {"reducedVolume": 0.8},
    windows=4,
    equilibration=steps,
    steps=steps,
    interval=5,
    thereAndBack=True,
    temperature=temperature,
)
for i, progress in enumerate(path.windows["lambda"]):
    print(
        f"lambda {progress:.2f}: reduced volume {path.windows['reducedVolume'][i]:.3f}, bending energy "
        f"{path.windows['E_bending'][i]:.0f} kT"
    )

cooled = mh.anneal(simulation, mh.ExponentialSchedule.over(5 * steps, temperature, 3 * unit.kelvin), 5 * steps)
energy = force.getEnergyTermsInContext(simulation.context)["bending"]
print(f"at {cooled.temperatures[-1]:.1f} K the bending energy is {energy / kT:.0f} kT")
