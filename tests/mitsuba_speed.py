"""Speed of Mitsuba 3 on its Cornell box, for comparison with `trace_speed` on the same scene of `mesh_scenes`.

    python3 tests/mitsuba_speed.py [SAMPLES]

Needs the Python package `mitsuba`, and for its LLVM back end a libLLVM.so of version 16 or newer, which
DRJIT_LIBLLVM_PATH may name. Prints samples per second of processor time, the best of three frames after the one that
compiles the kernels.
"""

import resource
import sys

import mitsuba
import numpy

EDGE = 512
MAX_DEPTH = 6  # edges: Carom's default of 5 scatterings


def cpu_secs():
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def main():
    samples = int(sys.argv[1]) if len(sys.argv) > 1 else 16
    mitsuba.set_variant("llvm_ad_rgb")
    description = mitsuba.cornell_box()
    description["integrator"] = {"type": "path", "max_depth": MAX_DEPTH, "rr_depth": 10_000}
    description["sensor"]["film"]["width"] = EDGE
    description["sensor"]["film"]["height"] = EDGE
    scene = mitsuba.load_dict(description)
    rates = []
    for seed in range(4):
        begun = cpu_secs()
        numpy.array(mitsuba.render(scene, spp=samples, seed=seed))
        rates.append(EDGE * EDGE * samples * 1e-6 / (cpu_secs() - begun))
    print(f"Mitsuba {mitsuba.__version__}, LLVM: {max(rates[1:]):.2f} Msample per core-second")


if __name__ == "__main__":
    main()
