#!/usr/bin/env python3
"""The CPU tracer against Mitsuba 3 on the same scene, in the same run.

    python3 tests/compare_mitsuba.py [--carom PATH] [--scene FILE] [--spp N] [--repetitions N]

Needs the Python packages `mitsuba` (its LLVM back end a libLLVM.so) and `numpy` and a release build of
`carom-farm`. Prints Msample per core-second of both, from the CPU time of both processes' threads,
their ratio, and the ratio of the pictures' means, which says that both have traced the same light.
"""

import argparse
import json
import pathlib
import resource
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
WIDTH, HEIGHT, SCATTERINGS = 1280, 720, 5


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--carom", default=ROOT / "target/release/carom-farm", type=pathlib.Path)
    parser.add_argument("--scene", default=ROOT / "assets/scenes/pool.json", type=pathlib.Path)
    parser.add_argument("--spp", default=4, type=int, help="samples per pixel")
    parser.add_argument("--repetitions", default=3, type=int)
    parser.add_argument("--variant", default="llvm_ad_rgb", help="Mitsuba's back end")
    args = parser.parse_args()
    try:
        import mitsuba
    except ImportError:
        sys.exit("Python has no `mitsuba`: pip install mitsuba")
    if not args.carom.exists():
        sys.exit(f"{args.carom} is not there: cargo build --release -p carom-farm")
    if args.variant not in mitsuba.variants():
        sys.exit(f"Mitsuba has no {args.variant}: one of {', '.join(mitsuba.variants())}")
    mitsuba.set_variant(args.variant)
    scene = mitsuba.load_dict(scene_dict(mitsuba, json.loads(args.scene.read_text())))

    theirs, ours = [], []
    render_mitsuba(mitsuba, scene, args.spp, 0)  # compiles
    for seed in range(1, args.repetitions + 1):
        theirs.append(render_mitsuba(mitsuba, scene, args.spp, seed))
        ours.append(bench_carom(args))
    rate, other = max(ours), max(rate for rate, _ in theirs)
    print(f"carom   {rate:8.3f} Msample/core-s")
    print(f"mitsuba {other:8.3f} Msample/core-s ({args.variant} {mitsuba.__version__})")
    print(f"ratio   {rate / other:8.2f}")
    means = [a / b for a, b in zip(mean_carom(mitsuba, args), theirs[-1][1])]
    print("mean radiance over Mitsuba's:", " ".join(f"{mean:.4f}" for mean in means))


def cpu_secs():
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def render_mitsuba(mitsuba, scene, spp, seed):
    """Msample per core-second, and the picture's mean."""
    import numpy

    begun = cpu_secs()
    picture = numpy.array(mitsuba.render(scene, spp=spp, seed=seed))
    secs = cpu_secs() - begun
    return WIDTH * HEIGHT * spp * 1e-6 / secs, picture.mean(axis=(0, 1)).tolist()


def bench_carom(args):
    command = [args.carom, "bench", "trace", "--json", "--backend", "cpu", "--repetitions", "1"]
    command += ["--size", f"{WIDTH}x{HEIGHT}", "--spp", str(args.spp), "--scene", args.scene]
    output = subprocess.run([str(word) for word in command], check=True, capture_output=True)
    return json.loads(output.stdout)["backends"][0]["msamples_per_core_second"]


def mean_carom(mitsuba, args):
    import numpy

    with tempfile.TemporaryDirectory() as folder:
        picture = pathlib.Path(folder) / "picture.exr"
        command = [args.carom, "render", "--scene", args.scene, "--out", picture]
        command += ["--size", f"{WIDTH}x{HEIGHT}", "--spp", "16", "--backend", "cpu"]
        subprocess.run([str(word) for word in command], check=True, capture_output=True)
        return numpy.array(mitsuba.Bitmap(str(picture)))[..., :3].mean(axis=(0, 1)).tolist()


def scene_dict(mitsuba, scene):
    camera = scene["camera"]
    result = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": SCATTERINGS + 1, "rr_depth": 10_000},
        "sensor": {
            "type": "perspective",
            "fov": camera["fov_x_deg"],
            "fov_axis": "x",
            "to_world": mitsuba.ScalarTransform4f().look_at(
                origin=camera["eye"], target=camera["target"], up=camera["up"]
            ),
            "film": {
                "type": "hdrfilm",
                "width": WIDTH,
                "height": HEIGHT,
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": "independent"},
        },
        "sky": {"type": "constant", "radiance": rgb(scene["environment"]["radiance"])},
    }
    for name, material in scene["materials"].items():
        result[name] = {"id": name, **bsdf(mitsuba, material)}
    for index, thing in enumerate(scene["objects"]):
        material = {"type": "ref", "id": thing["material"]}
        result[f"object{index}"] = {**shape(mitsuba, thing["shape"]), "bsdf": material}
    for index, lamp in enumerate(scene["lamps"]):
        emitter = {"type": "area", "radiance": rgb(lamp["radiance"])}
        result[f"lamp{index}"] = {**rectangle(mitsuba, lamp), "emitter": emitter}
    return result


def rgb(value):
    return {"type": "rgb", "value": value}


def bsdf(mitsuba, material):
    kind, given = next(iter(material.items()))
    if kind == "diffuse":
        # Plates and boxes here are seen from both sides.
        return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": rgb(given["albedo"])}}
    if kind == "smooth_plastic":
        stripe = given.get("stripe")
        diffuse = striped(mitsuba, given["albedo"], stripe) if stripe else rgb(given["albedo"])
        return {"type": "plastic", "int_ior": given["ior"], "diffuse_reflectance": diffuse}
    sys.exit(f"the material {kind} has no counterpart in this script")


def striped(mitsuba, albedo, stripe):
    """Rows are polar angles of the sphere's own axis."""
    import math

    import numpy

    rows = 256
    cosines = [math.cos(math.pi * (row + 0.5) / rows) for row in range(rows)]
    inside = [abs(cosine) < stripe["half_width"] for cosine in cosines]
    colors = [[stripe["albedo"] if is_inside else albedo] for is_inside in inside]
    bitmap = mitsuba.Bitmap(numpy.array(colors, dtype=numpy.float32))
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "filter_type": "nearest"}


def shape(mitsuba, given):
    transform = mitsuba.ScalarTransform4f
    kind, given = next(iter(given.items()))
    if kind == "sphere":
        x, y, z, w = given["rotation"]
        turn = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), 0],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), 0],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), 0],
            [0, 0, 0, 1],
        ]
        move = transform().translate(given["center"])
        return {"type": "sphere", "to_world": move @ transform(turn).scale(given["radius"])}
    if kind == "box":
        middle = [(a + b) / 2 for a, b in zip(given["min"], given["max"])]
        half = [(b - a) / 2 for a, b in zip(given["min"], given["max"])]
        return {"type": "cube", "to_world": transform().translate(middle).scale(half)}
    if kind == "disc":
        target = [a + b for a, b in zip(given["center"], given["normal"])]
        up = [1, 0, 0] if abs(given["normal"][0]) < 0.9 else [0, 1, 0]
        look = transform().look_at(origin=given["center"], target=target, up=up)
        return {"type": "disk", "to_world": look.scale(given["radius"])}
    if kind == "rectangle":
        return rectangle(mitsuba, given)
    sys.exit(f"the shape {kind} has no counterpart in this script")


def rectangle(mitsuba, given):
    u, v = given["half_u"], given["half_v"]
    normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
    length = sum(n * n for n in normal) ** 0.5
    columns = [u, v, [n / length for n in normal], given["center"]]
    rows = [[column[i] for column in columns] for i in range(3)] + [[0, 0, 0, 1]]
    return {"type": "rectangle", "to_world": mitsuba.ScalarTransform4f(rows)}


if __name__ == "__main__":
    main()
