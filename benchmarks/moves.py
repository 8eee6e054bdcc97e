"""Measure what docs/results/sampling.md says of shear waves and of momenta that are kept.

    python benchmarks/moves.py waves                            # how often waves are accepted, by their wave number
    python benchmarks/moves.py momenta --rounds 6 --seconds 30  # what an independent sample costs, with and without

Waves: a thermal sphere of 20 kT and a reduced volume of 0.95 with the default tether, and amplitudes of
0.76/(|k| sqrt(N)).  Momenta: a sphere of 642 vertices, 30 kT, with edges of length 1 and a tether of modulus 100 from
0.85 to 1.35, trajectories of 50 steps.  Both ways take turns; costs are counted in computations of the forces, which do
not depend on the machine, and errors come from the rounds.
"""

import argparse
import math
import time

import numpy as np

import openmmhelfrich as mh

WAVE_NUMBERS = (1, 1.5, 2, 3, 4, 6, 8, 12)
DEGREES = (2, 3, 4)
# Of trajectories: the acceptance that is aimed at and the refreshment.
WAYS = {"all drawn anew": (0.75, 1.0), "refreshment 0.35": (0.9, 0.35)}


def simulate(config, mesh):
    scene = mh.Scene.of({"platform": {"threads": 1}, **config}, mesh)
    force = scene.createForce()
    return scene.createSimulation(force), force


def measureWaves(subdivisions, moves, settle):
    """Print the acceptance of waves of each wave number, times the radius."""
    sampling = {"seed": 1, "shear_wave_probability": 0.1, "approach": "none", "trajectory_jitter": 0.3}
    mesh = mh.Mesh.icosphere(subdivisions)
    config = {"membrane": {"bending_modulus": 20, "reduced_volume": 0.95}, "sampling": sampling}
    simulation, _ = simulate(config, mesh)
    mh.adaptStepSize(simulation, settle)
    waves = simulation.integrator.getShearWaveIntegrator()
    radius, waves_per_step = math.sqrt(mesh.area / (4 * math.pi)), waves.getMovesPerStep()
    rates = []
    for number in WAVE_NUMBERS:
        k = number / radius
        waves.setWaveNumbers(k, k * (1 + 1e-6))
        waves.setAmplitude(0.76 / (k * math.sqrt(len(mesh.vertices))))
        before = waves.getNumAccepted(), waves.getNumAttempted()
        while waves.getNumAttempted() < before[1] + moves:
            waves.step(1)
            simulation.step(math.ceil(waves_per_step / 10))
        rates.append((waves.getNumAccepted() - before[0]) / (waves.getNumAttempted() - before[1]))
    print(f"N = {len(mesh.vertices)}: " + ", ".join(f"{k:g} {rate:.3f}" for k, rate in zip(WAVE_NUMBERS, rates)))


class Chain:
    """A sphere whose trajectories keep a part of their momenta."""

    def __init__(self, aim, refreshment, seed, settle):
        mesh = mh.Mesh.icosphere(3, math.sqrt(math.sqrt(3) * 642 / (8 * math.pi)))
        config = {
            "membrane": {"bending_modulus": 30, "area_modulus": 1e6, "volume_modulus": 1e6},
            "tether": {"modulus": 100, "min_length": 0.85, "max_length": 1.35, "length_scale": 1.0},
            "sampling": {
                "seed": seed,
                "steps_per_trajectory": 50,
                "flip_fraction": 0.3,
                "flip_probability": 0.3,
                "momentum_refreshment": refreshment,
            },
        }
        self._simulation, _ = simulate(config, mesh)
        mh.adaptStepSize(self._simulation, settle, aim)
        self._simulation.step(settle)
        self._trajectories = self._simulation.integrator.getMove(0)

    def sample(self, seconds):
        """Return the computations of forces for each independent sample of the modes of each degree, and the
        acceptance.
        """
        context, moves = self._simulation.context, self._trajectories
        before, start, frames = (moves.getNumAccepted(), moves.getNumAttempted()), time.process_time(), []
        while time.process_time() < start + seconds:
            self._simulation.step(1)
            vertices = context.getState(positions=True).getPositions(asNumpy=True)
            frames.append(mh.analysis.sphericalHarmonicCoefficients(vertices._value, max(DEGREES)))
        tried = moves.getNumAttempted() - before[1]
        evaluations, series = 50 * tried, np.array(frames)
        each = evaluations / len(frames)
        times = [mh.analysis.autocorrelationTime(series[:, degree**2 : (degree + 1) ** 2]) for degree in DEGREES]
        return each * np.array(times), (moves.getNumAccepted() - before[0]) / tried


def measureMomenta(rounds, seconds, settle):
    """Print what both ways cost, and the ratio."""
    chains = {way: Chain(*settings, seed, settle) for seed, (way, settings) in enumerate(WAYS.items(), 1)}
    costs, accepted = {way: [] for way in WAYS}, {way: [] for way in WAYS}
    for _ in range(rounds):
        for way, chain in chains.items():
            cost, rate = chain.sample(seconds)
            costs[way].append(cost)
            accepted[way].append(rate)
            print(f"{way}: {', '.join(f'{c:.0f}' for c in cost)}, accepted {rate:.0%}", flush=True)
    means = {way: np.mean(costs[way], axis=0) for way in WAYS}
    errors = {way: np.std(costs[way], axis=0, ddof=1) / math.sqrt(rounds) for way in WAYS}
    for way in WAYS:
        text = ", ".join(f"l = {d}: {m:.0f} +- {e:.0f}" for d, m, e in zip(DEGREES, means[way], errors[way]))
        print(f"{way}, accepted {np.mean(accepted[way]):.0%}: {text} computations of forces")
    old, new = WAYS
    ratios = means[old] / means[new]
    spread = ratios * np.hypot(errors[old] / means[old], errors[new] / means[new])
    print("gain: " + ", ".join(f"l = {d}: {r:.2f} +- {s:.2f}" for d, r, s in zip(DEGREES, ratios, spread)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["waves", "momenta"])
    parser.add_argument("--subdivisions", type=int, nargs="+", default=[3, 4], help="of the spheres that have waves")
    parser.add_argument("--moves", type=int, default=1500, help="waves of each wave number")
    parser.add_argument("--rounds", type=int, default=6)
    parser.add_argument("--seconds", type=float, default=30.0, help="of the processor, for each round and way")
    parser.add_argument("--settle", type=int, default=1500, help="steps that find the step size")
    options = parser.parse_args()
    if options.what == "waves":
        for subdivisions in options.subdivisions:
            measureWaves(subdivisions, options.moves, options.settle)
    else:
        measureMomenta(options.rounds, options.seconds, options.settle)


if __name__ == "__main__":
    main()
