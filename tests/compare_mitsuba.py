#!/usr/bin/env python3
"""The CPU tracer against Mitsuba 3 on the same scene, in the same run.

    python3 tests/compare_mitsuba.py [--carom PATH] [--scene FILE] [--spp N] [--repetitions N]

Needs the Python packages `mitsuba` (its LLVM back end a libLLVM.so of version 16 or newer) and `numpy` and
a release build of `carom-farm`. Prints Msample per core-second of both, from the CPU time of both
processes' threads, and their ratio, where the whole picture is traced with the maximum depth of 5 that ours is
measured with; and the ratio of the pictures' means, with the standard error that Mitsuba's has, which says
whether both have traced the same light.

Mitsuba moves the origins of rays off surfaces, by 9e-5 times one plus the largest coordinate. That takes
from a medium: `--about` and `--scale` give Mitsuba the scene moved to another origin and enlarged, which
changes what is moved and nothing else. For the wax ball of the materials scene:

    python3 tests/compare_mitsuba.py --scene assets/scenes/materials.json --size 480x270 \\
        --max-depth 63 --spp 256 --crop 20,85,125,125 --about=-0.496,0.042,0.05 --scale 100
"""

import argparse
import json
import pathlib
import resource
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
MAX_DEPTH = 5


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--carom", default=ROOT / "target/release/carom-farm", type=pathlib.Path)
    parser.add_argument("--scene", default=ROOT / "assets/scenes/pool.json", type=pathlib.Path)
    parser.add_argument("--spp", default=4, type=int, help="samples per pixel")
    parser.add_argument("--repetitions", default=3, type=int)
    parser.add_argument("--variant", default="llvm_ad_rgb", help="Mitsuba's back end")
    parser.add_argument("--size", default=[1280, 720], type=numbers(int, 2, "x"), help="pixels")
    parser.add_argument("--max-depth", default=MAX_DEPTH, type=int, help="maximum path depth")
    parser.add_argument("--crop", type=numbers(int, 4), help="x,y,width,height that are compared")
    parser.add_argument("--about", default=[0, 0, 0], type=numbers(float, 3), help="Mitsuba's origin")
    parser.add_argument("--scale", default=1.0, type=float, help="Mitsuba's units in a metre")
    args = parser.parse_args()
    is_timed = args.max_depth == MAX_DEPTH and not args.crop
    args.crop = args.crop or [0, 0, *args.size]
    try:
        import mitsuba
    except ImportError:
        sys.exit("Python has no `mitsuba`: pip install mitsuba")
    if not args.carom.exists():
        sys.exit(f"{args.carom} is not there: cargo build --release -p carom-farm")
    if args.variant not in mitsuba.variants():
        sys.exit(f"Mitsuba has no {args.variant}: one of {', '.join(mitsuba.variants())}")
    mitsuba.set_variant(args.variant)
    given = json.loads(args.scene.read_text())
    for thing in given["objects"]:
        if "mesh" in thing["shape"]:
            thing["shape"]["mesh"].setdefault("center", [0, 0, 0])
    given = moved(given, args.about, args.scale)
    with tempfile.TemporaryDirectory() as folder:
        scene = mitsuba.load_dict(scene_dict(mitsuba, given, args, pathlib.Path(folder)))

    theirs, ours = [], []
    render_mitsuba(mitsuba, scene, args, 0)  # compiles
    for seed in range(1, args.repetitions + 1):
        theirs.append(render_mitsuba(mitsuba, scene, args, seed))
        if is_timed:
            ours.append(bench_carom(args))
    other = max(rate for rate, _ in theirs)
    print(f"mitsuba {other:8.3f} Msample/core-s ({args.variant} {mitsuba.__version__})")
    if is_timed:
        print(f"carom   {max(ours):8.3f} Msample/core-s")
        print(f"ratio   {max(ours) / other:8.2f}")
    print_means(mean_carom(mitsuba, args), [mean for _, mean in theirs])


def numbers(kind, count, separator=","):
    def parse(text):
        values = [kind(value) for value in text.split(separator)]
        if len(values) != count:
            raise argparse.ArgumentTypeError(f"{text} is not {count} numbers")
        return values

    return parse


def print_means(ours, theirs):
    import numpy

    mean = numpy.mean(theirs, axis=0)
    print("mean radiance over Mitsuba's:", " ".join(f"{ratio:.4f}" for ratio in ours / mean))
    if len(theirs) > 1:
        error = numpy.std(theirs, axis=0, ddof=1) / len(theirs) ** 0.5 / mean
        print("standard error of Mitsuba's: ", " ".join(f"{one:.4f}" for one in error))


def cpu_secs():
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def render_mitsuba(mitsuba, scene, args, seed):
    """Msample per core-second, and the picture's mean."""
    import numpy

    begun = cpu_secs()
    picture = numpy.array(mitsuba.render(scene, spp=args.spp, seed=seed))
    secs = cpu_secs() - begun
    width, height = args.crop[2:]
    return width * height * args.spp * 1e-6 / secs, picture.mean(axis=(0, 1), dtype=float)


def bench_carom(args):
    command = [args.carom, "bench", "trace", "--json", "--backend", "cpu", "--repetitions", "1"]
    command += ["--size", size(args), "--spp", args.spp, "--scene", args.scene]
    output = subprocess.run([str(word) for word in command], check=True, capture_output=True)
    return json.loads(output.stdout)["backends"][0]["msamples_per_core_second"]


def mean_carom(mitsuba, args):
    import numpy

    with tempfile.TemporaryDirectory() as folder:
        picture = pathlib.Path(folder) / "picture.exr"
        command = [args.carom, "render", "--out", picture, "--backend", "cpu", "--scene", args.scene]
        command += ["--size", size(args), "--spp", args.spp, "--max-depth", args.max_depth]
        subprocess.run([str(word) for word in command], check=True, capture_output=True)
        x, y, width, height = args.crop
        bitmap = mitsuba.Bitmap(str(picture))
        channels = [field.name for field in bitmap.struct_()]
        colour = [channels.index(name) for name in "RGB"]
        pixels = numpy.array(bitmap)[y : y + height, x : x + width, colour]
        return pixels.mean(axis=(0, 1), dtype=float)


def size(args):
    return "x".join(map(str, args.size))


def moved(given, about, scale):
    """The same scene in other coordinates."""
    if isinstance(given, list):
        return [moved(part, about, scale) for part in given]
    if not isinstance(given, dict):
        return given
    result = {}
    for name, value in given.items():
        if name in ("eye", "target", "center", "min", "max"):
            value = [scale * (x - origin) for x, origin in zip(value, about)]
        elif name == "positions":
            value = [[scale * x for x in position] for position in value]
        elif name in ("half_u", "half_v"):
            value = [scale * x for x in value]
        elif name == "radius":
            value *= scale
        elif name == "extinction":
            value = [x / scale for x in value]
        else:
            value = moved(value, about, scale)
        result[name] = value
    return result


def scene_dict(mitsuba, scene, args, folder):
    camera = scene["camera"]
    lens = camera.get("lens", {"aperture_radius_m": 0.0, "focus_distance_m": 1.0})
    is_pinhole = lens["aperture_radius_m"] == 0.0
    x, y, width, height = args.crop
    result = {
        "type": "scene",
        "integrator": {
            "type": "volpath" if '"medium"' in json.dumps(scene) else "path",
            "max_depth": args.max_depth + 1,
            "rr_depth": 10_000,
        },
        "sensor": {
            "type": "perspective" if is_pinhole else "thinlens",
            **({} if is_pinhole else {
                "aperture_radius": lens["aperture_radius_m"] * args.scale,
                "focus_distance": lens["focus_distance_m"] * args.scale,
            }),
            "fov": camera["fov_x_deg"],
            "fov_axis": "x",
            "near_clip": 1e-3 * args.scale,
            "far_clip": 1e3 * args.scale,
            "to_world": mitsuba.ScalarTransform4f().look_at(
                origin=camera["eye"], target=camera["target"], up=camera["up"]
            ),
            "film": {
                "type": "hdrfilm",
                "width": args.size[0],
                "height": args.size[1],
                "crop_offset_x": x,
                "crop_offset_y": y,
                "crop_width": width,
                "crop_height": height,
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
        ply = folder / f"object{index}.ply"
        result[f"object{index}"] = {**shape(mitsuba, thing["shape"], ply), "bsdf": material}
        inside = scene["materials"][thing["material"]].get("dielectric", {}).get("medium")
        if inside:
            result[f"object{index}"]["interior"] = medium(inside)
    for index, light in enumerate(scene["area_lights"]):
        emitter = {"type": "area", "radiance": rgb(light["radiance"])}
        black = {"type": "diffuse", "reflectance": 0.0}
        result[f"light{index}"] = {**rectangle(mitsuba, light), "bsdf": black, "emitter": emitter}
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
    if kind == "dielectric":
        return {"type": "dielectric", "int_ior": given["ior"], "ext_ior": 1.0}
    if kind == "conductor":
        numbers = {"eta": rgb(given["eta"]), "k": rgb(given["k"]), "alpha": given["alpha"]}
        return {"type": "roughconductor", "distribution": "ggx", **numbers}
    sys.exit(f"the material {kind} has no counterpart in this script")


def medium(given):
    if len(set(given["extinction"])) > 1:
        sys.exit(f"extinctions {given['extinction']} that differ have no counterpart in this script")
    return {
        "type": "homogeneous",
        "sigma_t": given["extinction"][0],
        "albedo": rgb(given["albedo"]),
        "phase": {"type": "isotropic"},
    }


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


def shape(mitsuba, given, ply):
    transform = mitsuba.ScalarTransform4f
    kind, given = next(iter(given.items()))
    if kind == "sphere":
        move = transform().translate(given["center"]) @ transform(turn(given))
        return {"type": "sphere", "to_world": move.scale(given["radius"])}
    if kind == "mesh":
        write_ply(given, ply)
        move = transform().translate(given["center"]) @ transform(turn(given))
        return {"type": "ply", "filename": str(ply), "to_world": move}
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


def turn(given):
    x, y, z, w = given.get("rotation", [0, 0, 0, 1])
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), 0],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), 0],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), 0],
        [0, 0, 0, 1],
    ]


def write_ply(given, path):
    """Facets have corners of their own: Mitsuba would give shared ones a normal."""
    import numpy

    vertices = numpy.array(given["positions"], dtype="<f4")
    triangles = numpy.array(given["triangles"], dtype="<u4")
    names = ["x", "y", "z"]
    if given.get("normals"):
        vertices = numpy.hstack([vertices, numpy.array(given["normals"], dtype="<f4")])
        names += ["nx", "ny", "nz"]
    else:
        vertices = vertices[triangles.reshape(-1)]
        triangles = numpy.arange(triangles.size, dtype="<u4").reshape(-1, 3)
    faces = numpy.empty(len(triangles), dtype=[("length", "u1"), ("corners", "<u4", 3)])
    faces["length"], faces["corners"] = 3, triangles
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(faces)}", "property list uchar uint vertex_indices", "end_header"]
    text = "\n".join(header) + "\n"
    path.write_bytes(text.encode() + vertices.astype("<f4").tobytes() + faces.tobytes())


def rectangle(mitsuba, given):
    u, v = given["half_u"], given["half_v"]
    normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
    length = sum(n * n for n in normal) ** 0.5
    columns = [u, v, [n / length for n in normal], given["center"]]
    rows = [[column[i] for column in columns] for i in range(3)] + [[0, 0, 0, 1]]
    return {"type": "rectangle", "to_world": mitsuba.ScalarTransform4f(rows)}


if __name__ == "__main__":
    main()
