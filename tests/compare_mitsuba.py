#!/usr/bin/env python3
"""Carom against Mitsuba 3 on the same scene, in the same run: speed, and whether both trace the same light.

    python3 tests/compare_mitsuba.py [--carom PATH] [--scene FILE] [--spp N] [--repetitions N]

Needs the Python packages `mitsuba` (its LLVM back end a libLLVM.so of version 16 or newer, which DRJIT_LIBLLVM_PATH may
name) and `numpy` and a release build of `carom-farm`. Prints

- Msample per core-second of both, from the CPU time of both processes' threads (on a GPU, with `--variant cuda_ad_rgb`,
  Msample per second), and their ratio, the best of the repetitions of each, which take turns;
- the means of rectangular regions of the picture over Mitsuba's: how many of the values of all regions and channels
  lie more than 3 standard errors apart, of how many, the largest distance, and the mean of the whole picture. Standard
  errors are of the repetitions, each with a seed of its own. With N repetitions a distance is a t value of about
  2N - 2 degrees of freedom: of 16 and more few may be beyond 3 by chance (0.6 % at N = 8, 0.3 % at many). Differences
  below `--resolution` times the picture's mean, 1e-4, are none: that is what float32 pixels leave.

Mitsuba's Cornell box, a million triangles, and an environment map with textures:

    cargo run --release -p carom-tracer --example mesh_scenes -- FOLDER
    python3 tests/compare_mitsuba.py --scene FOLDER/cornell_box_white_lamp.json --cornell-box --size 512x512
    python3 tests/compare_mitsuba.py --scene FOLDER/bumpy_ball.json
    cargo run --release -p carom-tracer --example textured_scene -- FOLDER
    python3 tests/compare_mitsuba.py --scene FOLDER/matte_and_metal.json --resolution 3e-3

In the last both place the pixels of environment maps and filter distant textures by conventions of their own, which
is up to 0.3 % of a region. With `--cornell-box` Mitsuba traces its own box, not a translation of the file. Its lamp
reflects as its walls do; that of `cornell_box.json`, an area light, reflects nothing, so that its means lie lower.
Speed is measured where the whole picture is traced with the maximum depth of 5 that `carom-farm bench trace` has.

Mitsuba moves the origins of rays off surfaces, by 9e-5 times one plus the largest coordinate. That takes
from a medium: `--about` and `--scale` give Mitsuba the scene moved to another origin and enlarged, which
changes what is moved and nothing else. For the wax ball of the materials scene:

    python3 tests/compare_mitsuba.py --scene assets/scenes/materials.json --size 480x270 \\
        --max-depth 63 --spp 256 --crop 20,85,125,125 --about=-0.496,0.042,0.05 --scale 100
"""

import argparse
import base64
import json
import pathlib
import resource
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
MAX_DEPTH = 5


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--carom", default=ROOT / "target/release/carom-farm", type=pathlib.Path)
    parser.add_argument("--scene", default=ROOT / "assets/scenes/pool.json", type=pathlib.Path)
    parser.add_argument("--cornell-box", action="store_true", help="Mitsuba traces its own Cornell box")
    parser.add_argument("--spp", default=16, type=int, help="samples per pixel of a repetition")
    parser.add_argument("--repetitions", default=8, type=int)
    parser.add_argument("--variant", default="llvm_ad_rgb", help="Mitsuba's back end")
    parser.add_argument("--size", default=[640, 360], type=numbers(int, 2, "x"), help="pixels")
    parser.add_argument("--regions", default=[8, 6], type=numbers(int, 2, "x"), help="regions compared")
    parser.add_argument("--resolution", default=1e-4, type=float, help="least difference, of the picture's mean")
    parser.add_argument("--max-depth", default=MAX_DEPTH, type=int, help="maximum path depth")
    parser.add_argument("--crop", type=numbers(int, 4), help="x,y,width,height that are compared")
    parser.add_argument("--about", default=[0, 0, 0], type=numbers(float, 3), help="Mitsuba's origin")
    parser.add_argument("--scale", default=1.0, type=float, help="Mitsuba's units in a metre")
    args = parser.parse_args()
    is_timed = args.max_depth == MAX_DEPTH and not args.crop
    args.crop = args.crop or [0, 0, *args.size]
    if args.repetitions < 2:
        sys.exit(f"--repetitions {args.repetitions}: a standard error takes at least 2")
    try:
        import mitsuba
    except ImportError:
        sys.exit("Python has no `mitsuba`: pip install mitsuba")
    if not args.carom.exists():
        sys.exit(f"{args.carom} is not there: cargo build --release -p carom-farm")
    if args.variant not in mitsuba.variants():
        sys.exit(f"Mitsuba has no {args.variant}: one of {', '.join(mitsuba.variants())}")
    mitsuba.set_variant(args.variant)
    with tempfile.TemporaryDirectory() as folder:
        scene = mitsuba.load_dict(described(mitsuba, args, pathlib.Path(folder)))

    theirs, ours, their_rates, our_rates = [], [], [], []
    render_mitsuba(mitsuba, scene, args, 0)  # compiles
    for seed in range(1, args.repetitions + 1):
        rate, picture = render_mitsuba(mitsuba, scene, args, seed)
        their_rates.append(rate)
        theirs.append(region_means(picture, args.regions))
        ours.append(region_means(render_carom(mitsuba, args, seed), args.regions))
        if is_timed:
            our_rates.append(bench_carom(args))
    unit = "Msample/s" if on_gpu(args) else "Msample/core-s"
    print(f"mitsuba {max(their_rates):8.3f} {unit} ({args.variant} {mitsuba.__version__})")
    if is_timed:
        print(f"carom   {max(our_rates):8.3f} {unit}")
        print(f"ratio   {max(our_rates) / max(their_rates):8.2f}")
    print_agreement(args, ours, theirs)


def described(mitsuba, args, folder):
    """The scene as Mitsuba takes it."""
    if args.cornell_box:
        scene = mitsuba.cornell_box()
        scene["sensor"] |= film(args)
        return scene | {"integrator": integrator(args, "path")}
    given = json.loads(args.scene.read_text())
    for thing in given["objects"]:
        if "mesh" in thing["shape"]:
            thing["shape"]["mesh"].setdefault("center", [0, 0, 0])
    given = moved(given, args.about, args.scale)
    return scene_dict(mitsuba, given, args, folder)


def numbers(kind, count, separator=","):
    def parse(text):
        values = [kind(value) for value in text.split(separator)]
        if len(values) != count:
            raise argparse.ArgumentTypeError(f"{text} is not {count} numbers")
        return values

    return parse


def on_gpu(args):
    return args.variant.startswith("cuda")


def region_means(picture, regions):
    """Means of `regions` columns and rows, and of all: an array of one row of channels each."""
    import numpy

    columns, rows = regions
    blocks = [
        block.mean(axis=(0, 1), dtype=float)
        for row in numpy.array_split(picture, rows, axis=0)
        for block in numpy.array_split(row, columns, axis=1)
    ]
    return numpy.array([*blocks, picture.mean(axis=(0, 1), dtype=float)])


def print_agreement(args, ours, theirs):
    import numpy

    def mean_and_error(values):
        return numpy.mean(values, axis=0), numpy.std(values, axis=0, ddof=1) / len(values) ** 0.5

    (our_mean, our_error), (their_mean, their_error) = mean_and_error(ours), mean_and_error(theirs)
    error = numpy.hypot(our_error, their_error)
    difference = our_mean - their_mean
    counted = numpy.abs(difference) > args.resolution * their_mean[-1].max()
    apart = numpy.where(counted, numpy.abs(difference) / numpy.maximum(error, 1e-30), 0.0)[:-1]
    worst = numpy.unravel_index(apart.argmax(), apart.shape)
    row, column = divmod(worst[0], args.regions[0])
    print(
        f"regions more than 3 standard errors apart: {(apart > 3).sum()} of {apart.size};",
        f"at most {apart.max():.1f}, channel {worst[1]} of column {column}, row {row}:",
        f"{our_mean[worst] / their_mean[worst]:.4f} of Mitsuba's",
    )
    typical = numpy.median(error[:-1] / numpy.maximum(their_mean[:-1], 1e-30))
    print(f"standard error of a region's difference: {100 * typical:.2f} % of its mean (median)")
    ratios, errors = our_mean[-1] / their_mean[-1], error[-1] / their_mean[-1]
    parts = (f"{ratio:.4f} ± {one:.4f}" for ratio, one in zip(ratios, errors))
    print("mean of the picture over Mitsuba's:", ", ".join(parts))


def cpu_secs():
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def render_mitsuba(mitsuba, scene, args, seed):
    """Msample per core-second, or per second of a GPU, and the picture."""
    import numpy

    clock = time.monotonic if on_gpu(args) else cpu_secs
    begun = clock()
    picture = numpy.array(mitsuba.render(scene, spp=args.spp, seed=seed))
    secs = clock() - begun
    width, height = args.crop[2:]
    return width * height * args.spp * 1e-6 / secs, picture[..., :3]


def run_carom(args, *words):
    command = [args.carom, *words, "--backend", "gpu" if on_gpu(args) else "cpu"]
    command += ["--scene", args.scene, "--size", size(args), "--spp", args.spp]
    run = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    if run.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}: {run.stderr}")
    return run.stdout


def bench_carom(args):
    output = run_carom(args, "bench", "trace", "--json", "--repetitions", "1")
    key = "msamples_per_second" if on_gpu(args) else "msamples_per_core_second"
    return json.loads(output)["backends"][0][key]


def render_carom(mitsuba, args, seed):
    import numpy

    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "picture.exr"
        run_carom(args, "render", "--out", file, "--seed", seed, "--max-depth", args.max_depth)
        bitmap = mitsuba.Bitmap(str(file))
    channels = [field.name for field in bitmap.struct_()]
    colour = [channels.index(name) for name in "RGB"]
    x, y, width, height = args.crop
    return numpy.array(bitmap)[y : y + height, x : x + width, colour]


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


def integrator(args, kind):
    return {"type": kind, "max_depth": args.max_depth + 1, "rr_depth": 10_000}


def film(args):
    x, y, width, height = args.crop
    return {
        "film": {
            "type": "hdrfilm",
            "width": args.size[0],
            "height": args.size[1],
            "crop_offset_x": x,
            "crop_offset_y": y,
            "crop_width": width,
            "crop_height": height,
            "pixel_format": "rgb",
            "component_format": "float32",
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "independent"},
    }


def scene_dict(mitsuba, scene, args, folder):
    camera = scene["camera"]
    lens = camera.get("lens", {"aperture_radius_m": 0.0, "focus_distance_m": 1.0})
    is_pinhole = lens["aperture_radius_m"] == 0.0
    result = {
        "type": "scene",
        "integrator": integrator(args, "volpath" if '"medium"' in json.dumps(scene["materials"]) else "path"),
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
            **film(args),
        },
        "sky": environment(mitsuba, scene, folder),
    }
    textures = [bitmap(given, folder / f"texture{index}") for index, given in enumerate(scene.get("textures", []))]
    for name, material in scene["materials"].items():
        result[name] = {"id": name, **bsdf(mitsuba, material, textures)}
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


def environment(mitsuba, scene, folder):
    radiance, map_of_all = scene["environment"]["radiance"], scene.get("environment_map")
    if not map_of_all:
        return {"type": "constant", "radiance": rgb(radiance)}
    if len(set(radiance)) > 1 or map_of_all.get("turn_deg"):
        sys.exit("an environment map that is tinted or turned has no counterpart in this script")
    file = folder / "environment.exr"
    file.write_bytes(base64.b64decode(map_of_all["image"]["encoded"]))
    # Mitsuba's picture shows +z in its middle, -x in its right half and +y at its upper edge.
    turned = mitsuba.ScalarTransform4f([[-1, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    return {"type": "envmap", "filename": str(file), "scale": radiance[0], "to_world": turned}


def bitmap(given, file):
    """A texture, whose origin is the upper left in both."""
    if given.get("wrap", ["repeat"] * 2) != ["repeat"] * 2:
        sys.exit(f"the texture {given['name']} is not repeated, which has no counterpart in this script")
    file.write_bytes(base64.b64decode(given["image"]["encoded"]))
    return {"type": "bitmap", "filename": str(file), "raw": given.get("color_space") == "linear"}


def rgb(value):
    return {"type": "rgb", "value": value}


def bsdf(mitsuba, material, textures):
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
    if kind == "metallic_roughness":
        return metallic_roughness(given, textures)
    sys.exit(f"the material {kind} has no counterpart in this script")


def metallic_roughness(given, textures):
    """Lambert or a metal of Mitsuba's principled material: what lies between differs by intention."""
    used = {name: index for name, index in given.get("textures", {}).items() if index is not None}
    used.pop("normal_scale", None)
    base = used.pop("base_color", None)
    color = rgb(given["base_color"]) if base is None else textures[base]
    layers = given.get("layers", {})
    plain = not used and not any(given.get("emission", [0])) and given.get("opacity", "opaque") == "opaque"
    if base is not None and given["base_color"] != [1.0] * 3:
        plain = False
    if plain and given["metallic"] == 0.0 and layers.get("specular", 1.0) == 0.0:
        return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": color}}
    if plain and given["metallic"] == 1.0:
        numbers = {"metallic": 1.0, "roughness": given["roughness"], "specular": 0.5}
        return {"type": "principled", "base_color": color, **numbers}
    sys.exit(f"the metallic_roughness {given} has no counterpart in this script")


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
    if given.get("uvs"):
        vertices = numpy.hstack([vertices, numpy.array(given["uvs"], dtype="<f4")])
        names += ["u", "v"]
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
