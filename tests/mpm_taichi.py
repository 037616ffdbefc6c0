"""MLS-MPM in Taichi: CPU time of a particle over a substep, on one thread.

The same work as `carom-bench particles --part speed` does for jelly: a cube of elastic particles, eight a cell, falls
into a box and spreads. Fixed corotated elasticity, quadratic B-splines, APIC transfers (Hu et al. 2018, "A Moving
Least Squares Material Point Method with Displacement Discontinuity and Two-Way Rigid Body Coupling"; Jiang et al.
2015, "The Affine Particle-In-Cell Method").

    python3 tests/mpm_taichi.py [EDGE_IN_CELLS]    # 16 unless told: 32,768 particles

prints one line of JSON: {"particles": …, "substeps": …, "ns": …}. Needs taichi (1.7 was tried).
"""

import json
import sys
import time

import taichi as ti

ti.init(arch=ti.cpu, cpu_max_num_threads=1, default_fp=ti.f32, log_level=ti.ERROR)

EDGE = int(sys.argv[1]) if len(sys.argv) > 1 else 16
# A box of 2 by 1 by 2 cubes, as in the bench, in a grid with room for what lies at its faces.
MARGIN = 3
BOX = ti.Vector([2 * EDGE, EDGE + EDGE // 4, 2 * EDGE])
CELLS = (2 * EDGE + 2 * MARGIN, EDGE + EDGE // 4 + 2 * MARGIN, 2 * EDGE + 2 * MARGIN)
CELL_M = 0.01
DT = 1e-4
DENSITY = 1000.0
YOUNG_PA, POISSON = 5e3, 0.3
MU = YOUNG_PA / (2 * (1 + POISSON))
LAMBDA = YOUNG_PA * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
VOLUME_M3 = (CELL_M / 2) ** 3
MASS_KG = VOLUME_M3 * DENSITY
PARTICLES = (2 * EDGE) ** 3
PARTICLE_STEPS = 25_000_000

position = ti.Vector.field(3, float, PARTICLES)
velocity = ti.Vector.field(3, float, PARTICLES)
affine = ti.Matrix.field(3, 3, float, PARTICLES)
deformation = ti.Matrix.field(3, 3, float, PARTICLES)
momentum = ti.Vector.field(3, float, CELLS)
mass = ti.field(float, CELLS)


@ti.func
def weights(fraction):
    """Quadratic B-spline at the three nodes around, by the distance to the first in cells."""
    return [0.5 * (1.5 - fraction) ** 2, 0.75 - (fraction - 1.0) ** 2, 0.5 * (fraction - 0.5) ** 2]


@ti.kernel
def place():
    side = 2 * EDGE
    for i in position:
        at = ti.Vector([i % side, i // side % side, i // (side * side)])
        position[i] = (at.cast(float) / 2.0 + 0.25 + MARGIN) * CELL_M
        deformation[i] = ti.Matrix.identity(float, 3)


@ti.kernel
def scatter():
    for i in position:
        at = position[i] / CELL_M
        base = (at - 0.5).cast(int)
        fraction = at - base.cast(float)
        w = weights(fraction)
        f = deformation[i]
        u, _, v = ti.svd(f)
        j = f.determinant()
        rotation = u @ v.transpose()
        stress = 2.0 * MU * (f - rotation) @ f.transpose() + ti.Matrix.identity(float, 3) * (
            LAMBDA * j * (j - 1.0)
        )
        transfer = MASS_KG * affine[i] - (DT * VOLUME_M3 * 4.0 / (CELL_M * CELL_M)) * stress
        for offset in ti.static(ti.ndrange(3, 3, 3)):
            node = ti.Vector([offset[0], offset[1], offset[2]])
            weight = w[offset[0]][0] * w[offset[1]][1] * w[offset[2]][2]
            away = (node.cast(float) - fraction) * CELL_M
            momentum[base + node] += weight * (MASS_KG * velocity[i] + transfer @ away)
            mass[base + node] += weight * MASS_KG


@ti.kernel
def update():
    for node in ti.grouped(mass):
        if mass[node] > 0.0:
            v = momentum[node] / mass[node]
            v[1] -= DT * 9.81
            for axis in ti.static(range(3)):
                if node[axis] <= MARGIN and v[axis] < 0.0:
                    v[axis] = 0.0
                if node[axis] >= MARGIN + BOX[axis] and v[axis] > 0.0:
                    v[axis] = 0.0
            momentum[node] = v


@ti.kernel
def gather():
    for i in position:
        at = position[i] / CELL_M
        base = (at - 0.5).cast(int)
        fraction = at - base.cast(float)
        w = weights(fraction)
        moved = ti.Vector.zero(float, 3)
        c = ti.Matrix.zero(float, 3, 3)
        for offset in ti.static(ti.ndrange(3, 3, 3)):
            node = ti.Vector([offset[0], offset[1], offset[2]])
            weight = w[offset[0]][0] * w[offset[1]][1] * w[offset[2]][2]
            away = (node.cast(float) - fraction) * CELL_M
            v = momentum[base + node]
            moved += weight * v
            c += (4.0 / (CELL_M * CELL_M)) * weight * v.outer_product(away)
        velocity[i] = moved
        affine[i] = c
        position[i] += DT * moved
        deformation[i] = (ti.Matrix.identity(float, 3) + DT * c) @ deformation[i]


def substep():
    momentum.fill(0.0)
    mass.fill(0.0)
    scatter()
    update()
    gather()


place()
for _ in range(200):  # the kernels are compiled, and it begins to spread
    substep()
substeps = max(PARTICLE_STEPS // PARTICLES, 1)
start = time.process_time()
for _ in range(substeps):
    substep()
ti.sync()
spent = time.process_time() - start
low = min(position.to_numpy().min(), 1.0)
if not low > 0.0:
    sys.exit("the simulation broke: its particles are no numbers or have left the box")
print(json.dumps({"particles": PARTICLES, "substeps": substeps, "ns": spent * 1e9 / PARTICLES / substeps}))
