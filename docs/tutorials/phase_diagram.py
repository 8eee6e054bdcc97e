# %% [markdown]
# # A phase diagram
#
# Which shape has a vesicle whose volume is reduced to v? Long ones (prolates), flat ones (oblates) and inverted ones
# (stomatocytes) compete, and the lowest bending energy wins. This tutorial computes a small diagram: three starting
# shapes, each taken to four volumes, by two processes. It takes 42 seconds of processor time in all.
#
# You need `pip install 'openmm-helfrich[sweep]'`.

# %%
import csv
import os
from pathlib import Path

import matplotlib.pyplot as plt

import openmmhelfrich as mh

isSmall = os.environ.get("HELFRICH_TUTORIAL_SIZE") == "small"
branches = ["prolate"] if isSmall else ["prolate", "oblate", "stomatocyte"]
volumes = [0.75] if isSmall else [0.55, 0.6, 0.65, 0.75]

# %% [markdown]
# ## Where each branch begins
#
# A minimization goes to the nearest minimum, so each branch needs a start of its kind. `axisymmetricMinimum` computes
# smooth shapes without triangles, with their energies to compare with. `surfaceOfRevolution` covers the outline of
# one with even triangles. Stomatocytes exist up to v = 0.65.

# %%
smooth = {}
for branch in branches:
    known = [volume for volume in volumes if branch != "stomatocyte" or volume <= 0.65]
    smooth[branch] = {volume: mh.axisymmetricMinimum(branch, volume) for volume in known}
    outline = smooth[branch][volumes[0] if isSmall else 0.6].outline
    mh.surfaceOfRevolution(outline, 92 if isSmall else 642).write(f"{branch}.ply")

# %% [markdown]
# ## The grid
#
# A grid is a configuration, and values that some of its keys take. A *variant* changes several keys at once, here the
# starting shape.

# %%
variants = "\n".join(f'[variants.{branch}]\nmesh.file = "{branch}.ply"' for branch in branches)
Path("diagram.toml").write_text(f"""
[base.membrane]
bending_modulus = 20
[[base.stages]]
kind = "minimize"
fluid = true
max_iterations = {200 if isSmall else 20000}
[grid]
membrane.reduced_volume = {volumes}
{variants}
""")
print(mh.sweep("diagram.toml", "results/diagram", workers=1 if isSmall else 2))

# %% [markdown]
# Each point of the grid has a folder with its files, and `summary.csv` has a row for it. What is done stays done:
# started again, a sweep goes on where it was.
#
# ## The diagram
#
# A point may end on another branch than it began on. `shapeClass` says where it ended.

# %%
with open("results/diagram/summary.csv", newline="") as file:
    points = [point for point in csv.DictReader(file) if point["verdict"] in ("good", "doubtful")]
axes = plt.figure(figsize=(6, 4), layout="constrained").subplots()
for number, branch in enumerate(branches):
    exact = {volume: shape.energy for volume, shape in smooth[branch].items()}
    axes.plot(*zip(*exact.items()), "+-", color=f"C{number}", lw=1, ms=10)
    for point in points:
        volume, energy = float(point["reduced_volume"]), float(point["E_bending/8 pi kappa"])
        if point["shapeClass"] == branch:
            axes.plot(volume, energy, "o", color=f"C{number}")
            error = f"{energy / exact[volume] - 1:+.1%}" if volume in exact else ""
            print(f"{point['variant']} to {volume}: {branch}, E/8πκ = {energy:.3f} {error}")
    axes.plot([], [], "o", color=f"C{number}", label=branch)
axes.set(xlabel="reduced volume", ylabel="bending energy / 8πκ")
axes.legend(title="crosses: smooth shapes")
axes.figure.savefig("phase_diagram.png", dpi=110)

# %% [markdown]
# ![Bending energies of three branches beside those of smooth shapes](phase_diagram.png)
#
# Where the lines cross, the shape of lowest energy changes: from prolate to oblate at v = 0.65, and to the
# stomatocyte at 0.59. The points are 0.5 to 2.4% below the crosses, as meshes of 642 vertices are. The
# stomatocyte lives on at v = 0.75, where its energy is far from the lowest: a minimization does not leave its valley.
#
# ## Where to go
#
# - [Phase diagrams](../how-to/phase-diagrams.md) has the diagrams in full, also of area difference.
# - [Sweeps](../how-to/sweeps.md) says how grids run on clusters, and what happens if a machine fails.
